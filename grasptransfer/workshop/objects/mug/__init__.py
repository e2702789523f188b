"""Mugs: a hollow turned body with true walls, and a handle towards +x.

The body is one closed surface from the middle of the underside over the rim to the middle of the
floor; the handle is a sweep whose ends run into the wall.
"""

from dataclasses import asdict

import numpy as np

from grasptransfer.workshop.objects.mug import finish, parts
from grasptransfer.workshop.objects.mug.parameters import MugParameters
from grasptransfer.workshop.objects.shape import ParametricObject, Part, centred

PARAMETERS = MugParameters


def canonical() -> ParametricObject:
    """A plain cylindrical mug of the usual size with a D-shaped handle."""
    material = finish.canonical_materials()
    return _assemble(MugParameters(), material)


def build(parameters: MugParameters, rng: np.random.Generator) -> ParametricObject:
    """The mug of these parameters, in materials drawn from `rng`."""
    return _assemble(parameters, finish.draw_materials(parameters, rng))


def _assemble(p: MugParameters, materials: finish.MugMaterials) -> ParametricObject:
    handle = parts.handle(p)
    # The ends of the bar lie inside the wall, where no picture or scan ever sees them.
    buried = np.zeros((2 * parts.HANDLE_QUARTER + 5, parts.HANDLE_RING + 1), bool)
    buried[:3], buried[-3:] = True, True
    pieces = (
        Part.of("body", parts.body(p), materials.body),
        Part.of("handle", handle, materials.handle, ~buried.ravel()),
    )
    contents = (Part.of("drink", parts.drink(p), materials.drink),)
    return centred("mug", asdict(p), pieces, contents)
