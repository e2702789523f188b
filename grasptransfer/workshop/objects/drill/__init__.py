"""Pistol drills: cordless, compact, hammer and corded drills and drivers.

Built standing on the foot: the handle rises from it and carries the housing, whose axis points to +x
(up by `pitch`); clutch, chuck and bit sit on that axis.
"""

from dataclasses import asdict

import numpy as np

from grasptransfer.workshop.objects.drill import parts
from grasptransfer.workshop.objects.drill.finish import DrillFinish
from grasptransfer.workshop.objects.drill.paint import materials
from grasptransfer.workshop.objects.drill.parameters import DrillParameters
from grasptransfer.workshop.objects.shape import ParametricObject, Part, centred

PARAMETERS = DrillParameters
# Parts that some drills lack: there they hide inside others.
_OPTIONAL = ("bit", "speed_switch", "side_handle", "selector", "cord")


def build(parameters: DrillParameters, rng: np.random.Generator) -> ParametricObject:
    """A drill of these sizes, finished at random."""
    return _assemble(parameters, DrillFinish.draw(rng))


def canonical() -> ParametricObject:
    """A cordless drill of middling size in orange and black."""
    return _assemble(DrillParameters(), DrillFinish.typical())


def _assemble(p: DrillParameters, finish: DrillFinish) -> ParametricObject:
    turn, pivot = parts.pitched(p.pitch), (0.0, 0.0, p.housing_height)
    on_axis = (parts.housing, parts.clutch, parts.chuck, parts.bit, parts.speed_switch, parts.side_handle)
    upright = (parts.handle, parts.trigger, parts.selector, parts.foot, parts.battery, parts.cord)
    surfaces = {make.__name__: make(p).placed(pivot, turn) for make in on_axis}
    surfaces |= {make.__name__: make(p) for make in upright}
    painted = materials(finish, p.battery_height / p.foot_length)
    pieces = (
        Part.of(name, surface, painted[name], name not in _OPTIONAL) for name, surface in surfaces.items()
    )
    return centred("drill", asdict(p), tuple(pieces))
