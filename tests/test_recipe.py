"""Recipes of the parametric categories: what random shapes are drawn from, validated."""

from collections import Counter

import numpy as np
import pytest
import yaml

from grasptransfer.errors import SettingsError
from grasptransfer.workshop import objects
from grasptransfer.workshop.objects.recipe import Recipe, load_recipe
from grasptransfer.yaml_models import parse


def given(**changes) -> dict:
    recipe = {
        "description": "Boxes.",
        "density": 500,
        "train": [0, 1],
        "test": [2],
        "ranges": {"height": [0.1, 0.2]},
        "families": {"low": {"share": 0.75, "ranges": {"height": [0.01, 0.02]}}, "usual": {"share": 0.25}},
    }
    return recipe | changes


def read(data: dict) -> Recipe:
    return parse(Recipe, yaml.safe_load(yaml.safe_dump(data)), "recipe.yaml", error=SettingsError)


def test_families_come_in_their_shares_and_values_lie_in_their_ranges():
    recipe, rng = read(given()), np.random.default_rng(0)
    drawn = [recipe.draw(rng) for _ in range(2000)]
    shares = Counter(family for family, _ in drawn)
    assert abs(shares["low"] / 2000 - 0.75) < 0.04  # four standard deviations
    for family, values in drawn:
        low, high = (0.01, 0.02) if family == "low" else (0.1, 0.2)
        assert low <= values["height"] <= high


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"test": [1]}, "more than once"),
        ({"train": [-1]}, "negative"),
        ({"families": {"low": {"share": 0.5}}}, "make 0.5, not 1"),
        ({"ranges": {"height": [0.2, 0.1]}}, "above its end"),
        ({"ranges": {"height": ["tall", 1]}}, "height"),
        ({"colour": "red"}, "colour"),
        ({"families": {}}, "families"),
    ],
)
def test_a_mistake_in_a_recipe_is_named(changes, word):
    with pytest.raises(SettingsError, match=word):
        read(given(**changes))


@pytest.mark.parametrize("name", objects.generators())
def test_every_parametric_category_has_a_recipe_with_instances_that_do_not_overlap(name):
    recipe = load_recipe(name)
    assert len(recipe.train) >= 14
    assert len(recipe.test) >= 4
    for family in recipe.families.values():
        assert set(family.ranges) - set(recipe.ranges) <= set(objects.sample(name, 0).parameters) | {
            "slim", "cap_share"
        }  # fmt: skip
