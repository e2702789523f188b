"""The recipe of a parametric category: from which ranges its shapes are drawn, and which of them are shipped.

`<category>/recipe.yaml` holds it; a change there changes what seeds give. The geometry is Python beside it.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import SettingsError
from grasptransfer.yaml_models import Strict, parse

Ranges = dict[str, tuple[float, float]]


class Family(Strict):
    """A kind of the category.

    Args:
        share: share of all random shapes.
        ranges: lowest and highest value of the parameters that differ from the common ones.
    """

    share: float = Field(gt=0, le=1)
    ranges: Ranges = Field(default_factory=dict)


class Recipe(Strict):
    """What random shapes of a category are drawn from, and the seeds of the shipped ones.

    Args:
        description: description of the category, one line for people.
        density: of what an instance is made of, kg/m3 of the solid that its mesh encloses.
        train, test: seeds of the shipped instances, picked by eye; test spans the extremes and the typical.
        ranges: lowest and highest value of each parameter, drawn uniformly in this order.
        families: by name; their shares make one.
    """

    description: str
    density: float = Field(ge=1, le=30_000)
    train: tuple[int, ...] = Field(min_length=1)
    test: tuple[int, ...] = Field(min_length=1)
    ranges: Ranges
    families: dict[str, Family] = Field(min_length=1)

    @model_validator(mode="after")
    def _consistent(self) -> "Recipe":
        seeds = [*self.train, *self.test]
        twice = sorted({seed for seed in seeds if seeds.count(seed) > 1})
        if twice or min(seeds) < 0:
            raise ValueError(
                f"seed {twice[0] if twice else min(seeds)} is negative, or listed more than once"
            )
        whole = sum(family.share for family in self.families.values())
        if abs(whole - 1) > 1e-9:
            raise ValueError(f"the shares of the families make {whole:g}, not 1")
        for ranges in (self.ranges, *(family.ranges for family in self.families.values())):
            for name, (low, high) in ranges.items():
                if low > high:
                    raise ValueError(f"the range of {name} begins above its end")
        return self

    def draw(self, rng: np.random.Generator) -> tuple[str, dict[str, float]]:
        """A family, and values of its parameters."""
        names, shares = list(self.families), [family.share for family in self.families.values()]
        family = names[rng.choice(len(names), p=shares)]
        ranges = self.ranges | self.families[family].ranges
        return family, {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}


@lru_cache(maxsize=8)
def load_recipe(category: str) -> Recipe:
    """The recipe of a category that has a parametric model.

    Raises:
        SettingsError: it is missing, or a mistake in it, named by key and value.
    """
    path = Path(__file__).parent / category / "recipe.yaml"
    return parse(Recipe, read_yaml(path, error=SettingsError), path, error=SettingsError)
