"""Trigger spray bottles: a bottle, a screw ring, and a head with lever and nozzle that point to +x."""

from dataclasses import asdict

import numpy as np

from grasptransfer.workshop.objects.shape import ParametricObject, Part, centred
from grasptransfer.workshop.objects.spray_bottle import parts
from grasptransfer.workshop.objects.spray_bottle.finish import SprayBottleFinish
from grasptransfer.workshop.objects.spray_bottle.parameters import SprayBottleParameters

PARAMETERS = SprayBottleParameters


def build(parameters: SprayBottleParameters, rng: np.random.Generator) -> ParametricObject:
    """A spray bottle of these sizes, finished at random."""
    return _assemble(parameters, SprayBottleFinish.draw(rng))


def canonical() -> ParametricObject:
    """A white oval bottle of middling size with a blue head."""
    return _assemble(SprayBottleParameters(), SprayBottleFinish.typical())


def _assemble(p: SprayBottleParameters, finish: SprayBottleFinish) -> ParametricObject:
    materials = finish.materials((p.half_x, p.half_y, p.body_height), p.shoulder)
    outside = (parts.body, parts.collar, parts.stem, parts.head, parts.nozzle, parts.lever)
    inside = (parts.liquid, parts.dip_tube)
    pieces, contents = (
        tuple(Part.of(make.__name__, make(p), materials[make.__name__]) for make in group)
        for group in (outside, inside)
    )
    return centred("spray_bottle", asdict(p), pieces, contents)
