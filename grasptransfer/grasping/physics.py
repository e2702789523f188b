"""Mass, friction and grip force of a grasp, and how sure they are.

Each is a number, taken as exact, or a number and a factor: the true value is likely to lie between the number
divided by the factor and the number times the factor (one standard deviation on a logarithmic scale).
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import NOT_NUMBERS, SettingsError
from grasptransfer.grasping.scene import Scene

Uncertain = float | tuple[float, float]

MASS_FACTOR = 1.3  # of a mass that is only known as volume times density
# Rubber on glass, glaze or plastic, dry, as in the simulation protocols; a protocol's perturbed trials err
# by a fifth of it.
FRICTION = (0.8, 1.2)
FORCE = 40.0  # N of each pad, as in the simulation protocols; trials elsewhere use 20 to 40
BOUNDS = {"mass": (1e-3, 100.0), "friction": (0.01, 5.0), "force": (0.1, 10_000.0)}  # kg, 1, N
LARGEST_FACTOR = 10.0


@dataclass(frozen=True)
class Physics:
    """What decides whether a grip is strong enough.

    Args:
        mass: mass of the object [kg]; None: the volume of its reconstruction times its category's density.
        friction: Coulomb coefficient between pad and object.
        force: force of each pad [N]; None: 40 N, or the gripper's limit where that is less.
        up: against gravity, camera frame; None: the world's z axis, the support plane's normal, or the
            object's z axis, the first that is known.

    Raises:
        SettingsError: a number that is none, or out of its bounds.
    """

    mass: Any = None
    friction: Any = None
    force: Any = None
    up: Any = None

    def __post_init__(self):
        for key in BOUNDS:
            given = getattr(self, key)
            if given is not None:
                object.__setattr__(self, key, _checked(key, given))
        if self.up is not None:
            object.__setattr__(self, "up", _direction(self.up))

    def standing(
        self, scene: Scene | None, world_from_camera: Float[np.ndarray, "4 4"] | None = None
    ) -> "Physics":
        """The same, and up where it is known and not said.

        Args:
            scene: obstacles and a support plane, camera frame.
            world_from_camera: where the camera stands [m].
        """
        if self.up is not None:
            return self
        if world_from_camera is not None:
            return replace(self, up=world_from_camera[2, :3])
        plane = None if scene is None else scene.support_plane
        return self if plane is None else replace(self, up=plane[1])

    def held_by(self, force_limit: float) -> "Physics":
        """The same with a force that a gripper of this limit [N] can give."""
        force, factor = (FORCE, 1.0) if self.force is None else _pair(self.force)
        return replace(self, force=(min(force, force_limit), factor))

    def drawn(
        self, likely_mass: Float[np.ndarray, "s"], normal: Float[np.ndarray, "s 3"]
    ) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s"], Float[np.ndarray, "s"]]:
        """Mass [kg], friction and force [N] of each draw.

        Args:
            likely_mass: mass that is taken where none is given [kg].
            normal: standard normal variables, one for each of the three.
        """
        mass, factor = (likely_mass, MASS_FACTOR) if self.mass is None else _pair(self.mass)
        friction, slippery = _pair(FRICTION if self.friction is None else self.friction)
        force, weaker = _pair(FORCE if self.force is None else self.force)
        by = np.array([factor, slippery, weaker]) ** normal
        return mass * by[:, 0], friction * by[:, 1], force * by[:, 2]


def as_physics(given: object) -> Physics:
    """What an argument says: a `Physics`, a mapping of its fields, or None where nothing is known.

    Raises:
        SettingsError: none of these, or something in it is wrong.
    """
    if given is None or isinstance(given, Physics):
        return given or Physics()
    choices = [field.name for field in fields(Physics)]
    if not isinstance(given, Mapping):
        raise SettingsError("must be a Physics or a mapping", key="physics", value=given, choices=choices)
    for key in given:
        if key not in choices:
            raise SettingsError("is unknown", key=f"physics.{key}", value=given[key], choices=choices)
    return Physics(**given)


def _pair(given: Uncertain) -> tuple[float, float]:
    return given if isinstance(given, tuple) else (given, 1.0)


def _checked(key: str, given: object) -> Uncertain:
    low, high = BOUNDS[key]
    values: tuple[Any, ...] = tuple(given) if isinstance(given, list | tuple | np.ndarray) else (given,)
    numbers = all(
        isinstance(value, int | float | np.number) and not isinstance(value, bool) for value in values
    )
    right = numbers and len(values) in (1, 2) and low <= values[0] <= high
    if not (right and (len(values) == 1 or 1 <= values[1] <= LARGEST_FACTOR)):
        raise SettingsError(
            f"must be a number from {low:g} to {high:g}, or such a number and a factor from 1 to "
            f"{LARGEST_FACTOR:g}",
            key=key,
            value=given,
        )
    return float(values[0]) if len(values) == 1 else (float(values[0]), float(values[1]))


def _direction(given: object) -> Float[np.ndarray, "3"]:
    try:
        up = np.array(given, dtype=float)
    except NOT_NUMBERS:
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or np.linalg.norm(up) < 1e-9:
        raise SettingsError("must be a direction, three numbers that are not all 0", key="up", value=given)
    return up / np.linalg.norm(up)
