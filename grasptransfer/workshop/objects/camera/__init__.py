"""Cameras: compact, mirrorless, reflex, bridge, rangefinder and box cameras; the lens points to +x."""

from dataclasses import asdict

import numpy as np

from grasptransfer.workshop.objects.camera import parts
from grasptransfer.workshop.objects.camera.finish import CameraFinish
from grasptransfer.workshop.objects.camera.parameters import CameraParameters
from grasptransfer.workshop.objects.shape import ParametricObject, Part, centred

PARAMETERS = CameraParameters
_COMMON = (parts.body, parts.grip, parts.lens, parts.glass, parts.button)
# Parts that some cameras lack: there they hide in the body.
_OPTIONAL = (
    *(parts.hump, parts.mode_dial, parts.second_dial, parts.flash),
    *(parts.window, parts.shoe, parts.screen, parts.eyepiece),
)


def build(parameters: CameraParameters, rng: np.random.Generator) -> ParametricObject:
    """A camera of these sizes, finished at random."""
    return _assemble(parameters, CameraFinish.draw(rng))


def canonical() -> ParametricObject:
    """A mirrorless camera of middling size, black under a silver top."""
    return _assemble(CameraParameters(), CameraFinish.typical())


def _assemble(p: CameraParameters, finish: CameraFinish) -> ParametricObject:
    materials = finish.materials(humped=p.hump_height > 0)
    pieces = (
        Part.of(make.__name__, make(p), materials[make.__name__], make in _COMMON)
        for make in (*_COMMON, *_OPTIONAL)
    )
    return centred("camera", asdict(p), tuple(pieces))
