"""Our own parametric, textured object models, with exact correspondences between samples.

Every category is a folder: `recipe.yaml` (ranges, families,
seeds of the shipped shapes), `parameters` (a frozen dataclass that draws from it), `parts` (their
surfaces), `finish` (colours and materials); its `build(parameters, rng)` and `canonical()` make a `Shape`.
All shapes of a category share one topology.
"""

from functools import lru_cache
from importlib import import_module

from grasptransfer.errors import CategoryError, SettingsError, check_seed
from grasptransfer.workshop.objects.correspondence import SurfaceLocator, corresponding_points
from grasptransfer.workshop.objects.shape import Material, ParametricObject, Part

__all__ = [
    "Material",
    "ParametricObject",
    "Part",
    "SurfaceLocator",
    "canonical",
    "corresponding_points",
    "generators",
    "sample",
]

CATEGORIES = ("bottle", "camera", "spray_bottle", "drill", "mug")


def generators() -> tuple[str, ...]:
    """Names of the categories that have a parametric model."""
    return CATEGORIES


def sample(category: str, seed: int, **fixed) -> ParametricObject:
    """A random shape of `category`; the same seed gives the same shape.

    Args:
        category: one of `generators()`.
        seed: decides the parameters and the materials.
        fixed: parameters to set instead of drawing them, by name.

    Raises:
        CategoryError: there is no parametric model of that name.
        SettingsError: a parameter is unknown, or the seed negative.
    """
    import numpy as np

    module = _module(category)
    check_seed(seed)
    rng = np.random.default_rng(seed)
    parameters = module.PARAMETERS.draw(rng)
    return module.build(_fix(parameters, fixed), rng)


@lru_cache(maxsize=8)
def canonical(category: str) -> ParametricObject:
    """The plain, typical shape of `category` that all samples correspond to.

    Raises:
        CategoryError: there is no parametric model of that name.
    """
    return _module(category).canonical()


def _module(category: str):
    if category not in generators():
        raise CategoryError("has no parametric model", key="category", value=category, choices=generators())
    return import_module(f"{__name__}.{category}")


def _fix(parameters, fixed: dict):
    import dataclasses

    names = [field.name for field in dataclasses.fields(parameters)]
    for name in fixed:
        if name not in names:
            raise SettingsError("unknown parameter", key=name, value=fixed[name], choices=names)
    return dataclasses.replace(parameters, **fixed)
