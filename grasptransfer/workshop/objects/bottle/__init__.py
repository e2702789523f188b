"""Bottles: a body from the punt over shoulder and neck into the bore, a cap, and what is in them."""

from dataclasses import asdict

import numpy as np

from grasptransfer.workshop.objects.bottle import finish, parts
from grasptransfer.workshop.objects.bottle.parameters import BottleParameters
from grasptransfer.workshop.objects.shape import ParametricObject, Part, centred

PARAMETERS = BottleParameters


def canonical() -> ParametricObject:
    """A plain white half-litre bottle with a blue screw cap."""
    return _assemble(BottleParameters(), finish.canonical_materials())


def build(parameters: BottleParameters, rng: np.random.Generator) -> ParametricObject:
    """The bottle of these parameters, in materials drawn from `rng`."""
    return _assemble(parameters, finish.draw_materials(parameters, rng))


def _assemble(p: BottleParameters, materials: finish.BottleMaterials) -> ParametricObject:
    body = parts.body(p)
    # The bore lies under the cap of most bottles: no picture shows where its points are.
    seen = np.ones((len(body.vertices) // (parts.COLUMNS + 1), parts.COLUMNS + 1), bool)
    seen[-3:] = False
    pieces = (
        Part.of("body", body, materials.body, seen.ravel()),
        Part.of("cap", parts.cap(p), materials.cap),
    )
    contents = (Part.of("liquid", parts.liquid(p), materials.liquid),)
    return centred("bottle", asdict(p), pieces, contents)
