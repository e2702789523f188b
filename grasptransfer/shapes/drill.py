"""Pistol drills: cordless, compact, hammer and corded drills and drivers.

Built standing on the foot: the handle rises from it and carries the housing, whose axis points to +x
(up by `pitch`); clutch, chuck and bit sit on that axis.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.shapes.drill_finish import DrillFinish
from grasptransfer.shapes.shape import Part, Shape, centred
from grasptransfer.shapes.surfaces import (
    ALONG_X,
    Surface,
    circle,
    loft,
    revolve,
    rounded_box,
    superellipse,
    sweep,
)

_DOWN = -np.pi / 2  # seam of what lies along x: at its underside
_RANGES = {
    "body_length": (0.105, 0.145),
    "body_height": (0.054, 0.07),
    "slimness": (0.82, 1.0),
    "squareness": (2.0, 3.4),
    "rear_size": (0.8, 1.0),
    "rear_drop": (-0.002, 0.008),
    "rear_round": (0.008, 0.028),
    "front_size": (0.72, 0.98),
    "overhang": (0.04, 0.075),
    "pitch": (-0.5, 4.0),
    "clutch_length": (0.008, 0.03),
    "clutch_size": (0.72, 0.95),
    "chuck_length": (0.036, 0.066),
    "chuck_radius": (0.0165, 0.0225),
    "chuck_nose": (0.4, 0.75),
    "handle_length": (0.075, 0.11),
    "handle_depth": (0.034, 0.044),
    "handle_width": (0.028, 0.038),
    "rake": (2.0, 16.0),
    "swell": (0.0, 0.005),
    "throat": (0.0, 0.022),
    "trigger_length": (0.022, 0.034),
    "trigger_reach": (0.007, 0.016),
    "foot_length": (0.095, 0.128),
    "foot_width": (0.058, 0.084),
    "foot_forward": (0.55, 0.95),
    "foot_flare": (0.016, 0.042),
    "foot_curve": (0.5, 1.6),
    "foot_slope": (-0.08, 0.25),
    "foot_tilt": (-2.0, 2.0),
    "battery_height": (0.03, 0.058),
}
_FAMILIES = {
    "cordless": (0.36, {}),
    "compact": (
        0.2,
        {
            "body_length": (0.08, 0.115),
            "body_height": (0.045, 0.058),
            "overhang": (0.03, 0.058),
            "chuck_length": (0.022, 0.046),
            "chuck_radius": (0.0125, 0.018),
            "clutch_length": (0.006, 0.022),
            "handle_length": (0.055, 0.09),
            "handle_depth": (0.029, 0.038),
            "handle_width": (0.026, 0.033),
            "foot_length": (0.066, 0.1),
            "foot_width": (0.044, 0.06),
            "foot_flare": (0.01, 0.026),
            "battery_height": (0.012, 0.03),
        },
    ),
    "hammer": (
        0.16,
        {
            "body_length": (0.125, 0.165),
            "body_height": (0.06, 0.078),
            "rear_size": (0.92, 1.12),
            "rear_drop": (0.0, 0.016),
            "clutch_length": (0.014, 0.036),
            "foot_length": (0.11, 0.14),
            "foot_width": (0.07, 0.086),
            "battery_height": (0.04, 0.07),
            "squareness": (2.3, 3.8),
        },
    ),
    "slim_foot": (
        0.16,
        {
            "pitch": (2.0, 13.0),
            "rear_drop": (0.002, 0.018),
            "front_size": (0.55, 0.85),
            "clutch_size": (0.6, 0.85),
            "handle_length": (0.085, 0.125),
            "foot_flare": (0.014, 0.04),
            "foot_curve": (1.0, 2.2),
            "battery_height": (0.006, 0.016),
            "foot_slope": (-0.05, 0.05),
        },
    ),
    "corded": (
        0.12,
        {
            "body_length": (0.135, 0.18),
            "foot_length": (0.05, 0.062),
            "foot_width": (0.036, 0.044),
            "foot_forward": (0.3, 0.7),
            "foot_flare": (0.012, 0.026),
            "foot_slope": (-0.1, 0.1),
            "battery_height": (0.006, 0.014),
            "cord": (0.028, 0.05),
            "rake": (6.0, 20.0),
            "handle_length": (0.085, 0.115),
            "chuck_length": (0.036, 0.056),
        },
    ),
}


@dataclass(frozen=True)
class DrillParameters:
    """Sizes of a drill; the ranges that `draw` uses stand in `_RANGES` and `_FAMILIES`.

    Args:
        body_length, body_height: motor housing [m]. slimness: its width as a share of its height.
        squareness: exponent of its outline, 2 round to 4 square.
        rear_size, front_size: height of the ends as a share of `body_height`.
        rear_drop: how much lower the rear end sits [m]. rear_round: radius of its edge [m].
        overhang: from the handle's axis to the rear end [m]. pitch: housing axis above level [degrees].
        clutch_length [m]. clutch_size: diameter as a share of the housing's front.
        chuck_length, chuck_radius [m]. chuck_nose: radius of the tip as a share. bit: length [m], 0 without.
        handle_length: from the foot to the housing [m]. handle_depth (along x), handle_width [m].
        rake: lean of the handle, foot backwards [degrees]. swell: palm swell [m].
        throat: how far the handle's top runs forward under the housing [m].
        trigger_length (along the handle), trigger_reach (out of it) [m].
        foot_length, foot_width [m]. foot_forward: share of the foot's spare length ahead of the handle.
        foot_flare: height of the shell over the battery [m]. foot_curve: below 1 box-like, above 1 flared.
        foot_slope: rise of the joint towards the rear. foot_tilt: of the whole foot, front up [degrees].
        battery_height: height of the battery, or of the base plate of drills without one [m].
        cord: length of the cord's sleeve [m], 0 without.
        side_handle: length of an auxiliary handle towards +y [m], 0 without; `draw` never adds one, as it
            moves the centre of the bounding box aside.
    """

    body_length: float = 0.125
    body_height: float = 0.062
    slimness: float = 0.9
    squareness: float = 2.5
    rear_size: float = 0.92
    rear_drop: float = 0.003
    rear_round: float = 0.016
    front_size: float = 0.88
    overhang: float = 0.057
    pitch: float = 1.5
    clutch_length: float = 0.02
    clutch_size: float = 0.84
    chuck_length: float = 0.05
    chuck_radius: float = 0.02
    chuck_nose: float = 0.55
    bit: float = 0.0
    handle_length: float = 0.09
    handle_depth: float = 0.039
    handle_width: float = 0.032
    rake: float = 8.0
    swell: float = 0.0025
    throat: float = 0.01
    trigger_length: float = 0.028
    trigger_reach: float = 0.011
    foot_length: float = 0.108
    foot_width: float = 0.068
    foot_forward: float = 0.75
    foot_flare: float = 0.028
    foot_curve: float = 0.9
    foot_slope: float = 0.06
    foot_tilt: float = 0.0
    battery_height: float = 0.04
    cord: float = 0.0
    side_handle: float = 0.0

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "DrillParameters":
        """Sizes of a random drill: of one family, and as small or large as drills come."""
        names, shares = list(_FAMILIES), [share for share, _ in _FAMILIES.values()]
        family = names[rng.choice(len(names), p=shares)]
        ranges = _RANGES | _FAMILIES[family][1]
        drawn = {name: rng.uniform(low, high) for name, (low, high) in ranges.items()}
        if rng.random() < 0.12:
            drawn["bit"] = rng.uniform(0.008, 0.025)
        return replace(cls(), **drawn)

    @property
    def foot_height(self) -> float:
        """Where the handle begins [m above the ground]."""
        return self.battery_height + self.foot_flare

    @property
    def housing_height(self) -> float:
        """Height of the housing's axis over the handle [m above the ground]."""
        return self.foot_height + self.handle_length + self.body_height / 2

    def handle_x(self, z: float | Float[np.ndarray, "*r"]) -> float | Float[np.ndarray, "*r"]:
        """Where the handle's axis runs [m]; x = 0 at the housing's axis."""
        return -np.tan(np.radians(self.rake)) * (self.housing_height - z)


PARAMETERS = DrillParameters


def build(parameters: DrillParameters, rng: np.random.Generator) -> Shape:
    """A drill of these sizes, finished at random."""
    return _assemble(parameters, DrillFinish.draw(rng))


def canonical() -> Shape:
    """A cordless drill of middling size in orange and black."""
    return _assemble(DrillParameters(), DrillFinish.typical())


def _assemble(p: DrillParameters, finish: DrillFinish) -> Shape:
    turn, pivot = _pitched(p.pitch), (0.0, 0.0, p.housing_height)
    on_axis = {
        "housing": (_housing(p), True),
        "clutch": (_clutch(p), True),
        "chuck": (_chuck(p), True),
        "bit": (_bit(p), False),
        "speed_switch": (_speed_switch(p), False),
        "side_handle": (_side_handle(p), False),
    }
    upright = {
        "handle": (_handle(p), True),
        "trigger": (_trigger(p), True),
        "selector": (_selector(p), False),
        "foot": (_foot(p), True),
        "battery": (_battery(p), True),
        "cord": (_cord(p), False),
    }
    surfaces = {name: (surface.placed(pivot, turn), same) for name, (surface, same) in on_axis.items()}
    materials = finish.materials()
    parts = tuple(
        Part.of(name, surface, materials[name], same)
        for name, (surface, same) in (surfaces | upright).items()
    )
    return centred("drill", asdict(p), parts)


def _pitched(degrees: float) -> Float[np.ndarray, "3 3"]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def _smooth(low: float, high: float, x: Float[np.ndarray, "*r"]) -> Float[np.ndarray, "*r"]:
    """Rises from 0 at `low` to 1 at `high` without a kink."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _bump(centre: float, width: float, x: Float[np.ndarray, "*r"]) -> Float[np.ndarray, "*r"]:
    return np.exp(-(((x - centre) / width) ** 2))


def _housing(p: DrillParameters) -> Surface:
    corner = np.linspace(0, np.pi / 2, 6)[:-1]
    rounding = min(p.rear_round, p.body_height * 0.45)
    x = np.concatenate([rounding * (1 - np.cos(corner)), np.linspace(rounding, p.body_length, 16)])
    inset = np.concatenate([rounding * (1 - np.sin(corner)), np.zeros(16)])
    inset[-2:] += [0.0, 0.0015]
    t = x / p.body_length
    size = p.rear_size + (1 - p.rear_size) * _smooth(0, 0.45, t)
    size -= (1 - p.front_size) * _smooth(0.5, 0.97, t)
    half_height = size * p.body_height / 2 - inset
    half_width = size * p.slimness * p.body_height / 2 - inset
    sections = superellipse(40, half_width, half_height, p.squareness, start=_DOWN)
    sections[..., 1] -= p.rear_drop * (1 - _smooth(0, 0.6, t))[:, None]
    return loft(x - p.overhang, sections).placed(rotation=ALONG_X)


def _front(p: DrillParameters) -> tuple[float, float]:
    """Where the housing ends on the axis [m], and its radius there [m]."""
    return p.body_length - p.overhang, p.front_size * p.slimness * p.body_height / 2


def _clutch(p: DrillParameters) -> Surface:
    start, front = _front(p)
    radius = max(p.clutch_size * front, p.chuck_radius * 1.04)
    along = np.array([-0.25, -0.25, 0.0, 0.12, 0.16, 0.2, 0.84, 0.88, 0.94, 1.0, 1.0])
    size = np.array([0.0, 0.96, 0.98, 0.98, 0.93, 1.0, 1.0, 0.96, 0.93, 0.86, 0.0])
    profile = np.stack([radius * size, start + p.clutch_length * along - 0.002], -1)
    ripple = 1 + 0.012 * np.cos(np.arange(48) * np.pi)
    sections = np.repeat(circle(48, _DOWN)[None], len(profile), axis=0)
    sections[5:7] *= ripple[:, None]
    v = np.interp(along + np.linspace(0, 1e-3, 11), [-0.25, 1.0], [0.0, 1.0])
    return revolve(profile, 48, section=sections, v=v, creases=(1, 9)).placed(rotation=ALONG_X)


def _chuck(p: DrillParameters) -> Surface:
    start = _front(p)[0] + p.clutch_length - 0.004
    along = np.array(
        [0, 0, 0.06, 0.3, 0.32, 0.36, 0.38, 0.64, 0.7, 0.8, 0.9, 0.97, 1.0, 1.0, 0.99, 0.86, 0.86]
    )
    nose = p.chuck_nose
    taper = 1 - (1 - nose) * _smooth(0.62, 0.98, along[:13])
    size = np.array([0, 0.9, 0.97, 0.98, 0.93, 0.93, 1, 1, 1, 1, 1, 0.98, 0.9]) * taper
    hole = np.array([0.45, 0.32, 0.3, 0.0]) * max(nose, 0.5)
    profile = np.stack(
        [p.chuck_radius * np.concatenate([size, hole]), start + (p.chuck_length + 0.004) * along], -1
    )
    ripple = 1 + 0.022 * np.cos(np.arange(48) * np.pi / 2)
    sections = np.repeat(circle(48, _DOWN)[None], len(profile), axis=0)
    sections[6:8] *= ripple[:, None]
    sections[2:4] *= 1 + 0.6 * (ripple[:, None] - 1)
    v = np.concatenate(
        [np.linspace(0, 0.02, 2), np.interp(along[2:13], [0, 1], [0.05, 0.9]), [0.92, 0.94, 0.97, 1]]
    )
    return revolve(profile, 48, section=sections, v=v, creases=(1, 5, 13)).placed(rotation=ALONG_X)


def _bit(p: DrillParameters) -> Surface:
    tip = _front(p)[0] + p.clutch_length + p.chuck_length
    start = tip - 0.12 * p.chuck_length - 0.004
    end = tip + p.bit if p.bit > 0 else tip - 0.1 * p.chuck_length  # without a bit, it hides in the chuck
    radius = min(0.2 * p.chuck_radius, 0.0035)
    along = np.array([0, 0, 0.3, 0.55, 0.6, 0.85, 1.0])
    size = np.array([0, 1, 1, 1, 0.72, 0.72, 0])
    return revolve(np.stack([radius * size, start + (end - start) * along], -1), 12).placed(rotation=ALONG_X)


def _speed_switch(p: DrillParameters) -> Surface:
    x = 0.55 * p.body_length - p.overhang
    box = rounded_box((0.012, 0.0065, 0.005), radius=0.003, fillet=0.0015, rows=2)
    return box.placed((x, 0, p.body_height / 2 - 0.002))


def _side_handle(p: DrillParameters) -> Surface:
    reach = p.side_handle if p.side_handle > 0 else 0.3 * p.slimness * p.body_height
    share = 1.0 if p.side_handle > 0 else 0.3
    along = np.array([0, 0, 0.22, 0.24, 0.26, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0, 1.0])
    size = np.array([0, 0.7, 0.7, 1.3, 1.3, 0.85, 1, 1, 0.95, 1.1, 0.9, 0])
    profile = np.stack([0.0145 * share * size, reach * along], -1)
    sideways = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    start = _front(p)[0] - 0.022
    return revolve(profile, 24).placed((start, 0, -0.1 * p.body_height), sideways)


def _handle(p: DrillParameters) -> Surface:
    s = np.linspace(0, 1, 22)
    low, high = p.foot_height - 0.004, p.housing_height - 0.1 * p.body_height
    z = low + (high - low) * s
    reached = (z - low) / (p.handle_length + 0.004)  # 1 at the housing's underside
    middle = p.handle_x(z)
    throat = min(p.throat, 0.9 * (p.body_length - p.overhang) - p.handle_depth / 2)
    waist = 0.06 * p.handle_depth * _bump(0.85, 0.12, reached)
    back = middle - p.handle_depth / 2 - p.swell * _bump(0.55, 0.22, reached) + waist
    back -= 0.25 * min(p.overhang, 0.05) * _smooth(0.86, 1.15, reached)
    front = middle + p.handle_depth / 2 + 0.4 * p.swell * _bump(0.35, 0.15, reached)
    front += throat * _smooth(0.7, 1.0, reached)
    width = p.handle_width / 2 * (1 + 0.06 * _bump(0.5, 0.25, reached) - 0.05 * _bump(0.85, 0.1, reached))
    width += (0.36 * p.slimness * p.body_height - p.handle_width / 2) * _smooth(0.9, 1.25, reached)
    sections = superellipse(36, (front - back) / 2, width, 2.4)
    sections[..., 0] += ((front + back) / 2)[:, None]
    return loft(z, sections)


def _trigger(p: DrillParameters) -> Surface:
    s = np.linspace(0, 1, 11)
    high = p.foot_height + p.handle_length - 0.003
    z = high - p.trigger_length * (1 - s)
    hook = p.trigger_reach * (0.72 + 0.28 * np.cos(2 * np.pi * s) + 0.1 * s)
    end = np.sqrt(1 - np.clip(np.abs(2 * s - 1) - 0.75, 0, 1) ** 2 / 0.25**2 * 0.9)  # round ends
    inside, outside = p.handle_x(z) + 0.2 * p.handle_depth, p.handle_x(z) + p.handle_depth / 2 + hook * end
    sections = superellipse(24, (outside - inside) / 2, 0.27 * p.handle_width * (0.85 + 0.15 * end), 3.0)
    sections[..., 0] += ((outside + inside) / 2)[:, None]
    return loft(z, sections)


def _selector(p: DrillParameters) -> Surface:
    z = p.foot_height + p.handle_length - 0.002
    box = rounded_box((0.0075, 0.5 * p.handle_width + 0.0045, 0.0035), radius=0.002, fillet=0.001, rows=2)
    return box.placed((p.handle_x(z) + 0.12 * p.handle_depth, 0, z))


def _foot_ends(p: DrillParameters) -> tuple[float, float]:
    """Rear and front end of the foot [m]."""
    middle = p.handle_x(p.foot_height)
    spare = p.foot_length - p.handle_depth
    front = middle + p.handle_depth / 2 + p.foot_forward * spare
    return front - p.foot_length, front


def _tilted(p: DrillParameters, surface: Surface, lean: Float[np.ndarray, "v"]) -> Surface:
    """Shear the foot along z by the joint's slope (as far as `lean` says) and by its tilt."""
    along = surface.vertices[:, 0] - p.handle_x(p.foot_height)
    rise = np.tan(np.radians(p.foot_tilt)) - p.foot_slope * lean
    lift = np.stack([np.zeros_like(along), np.zeros_like(along), along * rise], -1)
    return replace(surface, vertices=surface.vertices + lift)


def _foot(p: DrillParameters) -> Surface:
    rear, front = _foot_ends(p)
    q = np.concatenate([[0.0, 0.06], np.linspace(0.15, 1.0, 11)])
    z = p.battery_height - 0.002 + (p.foot_flare + 0.006) * q
    spread = (1 - np.clip(q - 0.06, 0, 1) / 0.94) ** p.foot_curve
    top = p.handle_x(p.foot_height)
    grip = 1.02 * p.handle_depth / 2
    ends = [
        np.array([top - grip, top + grip]) + share * (np.array([rear, front]) - [top - grip, top + grip])
        for share in spread
    ]
    back, ahead = np.array(ends).T
    half_width = 1.02 * p.handle_width / 2 + spread**0.8 * (p.foot_width - 1.02 * p.handle_width) / 2
    edge = np.where(q == 0, 0.0012, 0.0)
    sections = superellipse(40, (ahead - back) / 2 - edge, half_width - edge, 2.4 + 1.8 * spread**0.5)
    sections[..., 0] += ((ahead + back) / 2)[:, None]
    surface = loft(z, sections)
    share = (surface.vertices[:, 2] - z[0]) / (z[-1] - z[0])
    return _tilted(p, surface, 1 - _smooth(0.1, 0.9, share))


def _battery(p: DrillParameters) -> Surface:
    rear, front = _foot_ends(p)
    fillet = min(0.006, 0.4 * p.battery_height)
    arc = np.linspace(0, np.pi / 2, 4)
    z = np.concatenate([fillet * (1 - np.cos(arc)), np.linspace(fillet, p.battery_height, 8)[1:]])
    inset = np.concatenate([fillet * (1 - np.sin(arc)), np.zeros(7)])
    inset[-1] = 0.001
    half_length, half_width = p.foot_length / 2 - inset, p.foot_width / 2 - inset
    sections = superellipse(40, half_length, half_width, 4.6)
    sections[..., 0] += (rear + front) / 2
    surface = loft(z, sections)
    return _tilted(p, surface, surface.vertices[:, 2] / p.battery_height)


def _cord(p: DrillParameters) -> Surface:
    rear = _foot_ends(p)[0]
    z = p.battery_height + 0.2 * p.foot_flare
    reach = p.cord if p.cord > 0 else -0.008  # without a cord, the sleeve hides in the foot
    s = np.linspace(0, 1, 12)
    path = np.stack([rear + 0.012 - (reach + 0.012) * s, 0 * s, z - 0.2 * reach * s**2], -1)
    radius = np.where(s < 0.7, 0.0062 - 0.002 * s + 0.0005 * np.cos(np.arange(12) * np.pi), 0.0034)
    sections = radius[:, None, None] * circle(14)
    return sweep(path, sections)
