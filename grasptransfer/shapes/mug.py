"""Mugs: a hollow turned body with true walls, and a handle towards +x.

The body is one closed surface from the middle of the underside over the rim to the middle of the
floor; the handle is a sweep whose ends run into the wall.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.shapes import mug_finish
from grasptransfer.shapes.shape import Part, Shape, centred
from grasptransfer.shapes.surfaces import Surface, resample, revolve, superellipse, sweep, tube

COLUMNS = 48
_ROUND, _WALL, _RIM, _INSIDE, _FLOOR = 5, 28, 5, 11, 5  # rows of the body's regions
_QUARTER, _RING = 13, 14  # handle: rows from an end to the outermost point, columns
# Texture bands of the body: underside, outside, rim, inside wall, floor.
V_UNDER, V_OUTSIDE, V_RIM, V_INSIDE = 0.06, 0.70, 0.75, 0.94


@dataclass(frozen=True)
class MugParameters:
    """What makes one mug; metres, or shares as said. `draw` documents the ranges.

    Args:
        height: of the body.
        radius: of the body at the rim.
        base: radius at the bottom as a share of `radius`.
        curve: exponent of the way from base to rim: 1 a cone, below 1 a bowl, above 1 a trumpet.
        belly: bulge half-way up, share of `radius`; negative is a waist. belly_at: its height, share.
        lip: outward flare of the uppermost part, share of `radius`.
        bottom_round: radius of the lower edge, share of `radius`.
        foot, foot_inset: height of the foot ring, and how much narrower it is (share).
        recess: how far the underside is hollowed.
        wall, floor: thickness.
        square: exponent of the section: 2 round, 4 a rounded square.
        bands, band_size: raised rings around the body, and how far they stand out.
        handle_top, handle_bottom: heights of its ends, share of `height`.
        reach: how far the handle's centre line stands off the wall.
        peak: where it is furthest, share of the way from its lower to its upper end.
        square_top, square_bottom: exponents of its two quarters: 2 an arc, 5 a corner, 1.2 a straight slope.
        swell: how far it rises above and below its ends, share of its height.
        tilt: outward lean of its upper part (negative: of its lower part), share of `reach`.
        gap: 0 if the lower end meets the wall, else how far off it hangs, share of `reach`.
        thickness, width: of the bar, across and along the wall. bar: exponent of its section.
        pinch: how much narrower the bar is half-way, share. root: how much thicker at the wall, share.
        fill: level of what is in it, share of the inside; seen through glass only.
    """

    height: float = 0.095
    radius: float = 0.041
    base: float = 0.97
    curve: float = 1.0
    belly: float = 0.0
    belly_at: float = 0.5
    lip: float = 0.0
    bottom_round: float = 0.12
    foot: float = 0.001
    foot_inset: float = 0.04
    recess: float = 0.002
    wall: float = 0.0042
    floor: float = 0.006
    square: float = 2.0
    bands: int = 0
    band_size: float = 0.0
    handle_top: float = 0.80
    handle_bottom: float = 0.24
    reach: float = 0.028
    peak: float = 0.53
    square_top: float = 2.5
    square_bottom: float = 2.3
    swell: float = 0.04
    tilt: float = 0.0
    gap: float = 0.0
    thickness: float = 0.0085
    width: float = 0.0135
    bar: float = 2.4
    pinch: float = 0.05
    root: float = 0.12
    fill: float = 0.02

    @staticmethod
    def draw(rng: np.random.Generator) -> "MugParameters":
        """A plausible mug; straight, tapered, bellied, espresso, soup, latte or keg."""
        kind = str(rng.choice(list(_KINDS), p=[share for share, _ in _KINDS.values()]))
        ranges = {**_COMMON, **_KINDS[kind][1]}
        values = {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}
        values |= _draw_handle(rng, values["height"])
        if rng.random() < 0.55:  # half of all mugs stand flat, without a visible foot
            values |= {"foot": 0.0006, "foot_inset": 0.0}
        if rng.random() < 0.12:
            values["square"] = float(rng.uniform(2.6, 5))
        if rng.random() < (0.8 if kind == "keg" else 0.08):
            values |= {"bands": int(rng.integers(1, 4)), "band_size": float(rng.uniform(0.0006, 0.0022))}
        return MugParameters(**values)


_COMMON = {
    "height": (0.080, 0.112),
    "radius": (0.034, 0.046),
    "base": (0.94, 1.02),
    "curve": (0.8, 1.3),
    "belly": (-0.03, 0.03),
    "belly_at": (0.35, 0.65),
    "lip": (0.0, 0.02),
    "bottom_round": (0.03, 0.28),
    "foot": (0.001, 0.006),
    "foot_inset": (0.02, 0.15),
    "recess": (0.0008, 0.004),
    "wall": (0.0025, 0.0065),
    "floor": (0.004, 0.010),
}
# Share of all mugs, and the ranges that differ from the common ones.
_KINDS: dict[str, tuple[float, dict[str, tuple[float, float]]]] = {
    "straight": (0.36, {}),
    "tapered": (
        0.20,
        {"base": (0.6, 0.92), "curve": (0.45, 1.7), "radius": (0.038, 0.056), "bottom_round": (0.03, 0.4)},
    ),
    "bellied": (0.12, {"base": (0.7, 1.0), "belly": (0.06, 0.22), "lip": (0.0, 0.10), "radius": (0.033, 0.045)}),
    "espresso": (
        0.08,
        {"height": (0.048, 0.068), "radius": (0.026, 0.036), "base": (0.6, 0.98), "curve": (0.5, 1.4)},
    ),
    "soup": (
        0.09,
        {"height": (0.055, 0.085), "radius": (0.050, 0.068), "base": (0.5, 0.9), "curve": (0.4, 1.0), "lip": (0, 0.05)},
    ),
    "latte": (
        0.07,
        {"height": (0.11, 0.14), "radius": (0.038, 0.047), "base": (0.55, 0.85), "curve": (0.8, 1.6), "lip": (0, 0.08)},
    ),
    "trumpet": (
        0.04,
        {"base": (0.6, 0.75), "curve": (1.6, 2.6), "radius": (0.045, 0.056), "height": (0.07, 0.09)},
    ),
    "keg": (0.04, {"belly": (-0.02, 0.18), "base": (0.9, 1.15), "wall": (0.004, 0.008)}),
}  # fmt: skip


def _draw_handle(rng: np.random.Generator, height: float) -> dict[str, float]:
    kind = rng.choice(["C", "D", "ear", "square", "hook"], p=[0.34, 0.26, 0.2, 0.17, 0.03])
    squares = {
        "C": ((1.8, 2.3), (1.8, 2.3)),
        "D": ((2.3, 3.5), (2.3, 3.5)),
        "ear": ((1.9, 3.6), (1.1, 1.7)),
        "square": ((3.5, 7.0), (3.5, 7.0)),
        "hook": ((4.0, 7.0), (3.0, 5.0)),
    }[str(kind)]
    top = rng.uniform(0.70, 0.95)
    bottom = rng.uniform(0.08, 0.42)
    values = {
        "handle_top": top,
        "handle_bottom": min(bottom, top - 0.36),
        "reach": float(np.clip(height * rng.uniform(0.18, 0.37), 0.014, 0.037)),
        "peak": rng.uniform(0.58, 0.82) if kind == "ear" else rng.uniform(0.38, 0.66),
        "square_top": rng.uniform(*squares[0]),
        "square_bottom": rng.uniform(*squares[1]),
        "swell": rng.uniform(0, 0.22) if kind in "CD" and rng.random() < 0.5 else rng.uniform(-0.04, 0.04),
        "tilt": rng.normal(0, 0.14),
        "gap": rng.uniform(0.5, 0.9) if kind == "hook" else 0.0,
        "thickness": rng.uniform(0.0045, 0.0115) * (0.75 if height < 0.07 else 1),
        "width": rng.uniform(0.007, 0.019) * (0.75 if height < 0.07 else 1),
        "bar": rng.uniform(2.0, 4.5),
        "pinch": rng.uniform(-0.1, 0.3),
        "root": rng.uniform(0.0, 0.45),
        "fill": rng.uniform(0.4, 0.9) if rng.random() < 0.6 else 0.02,
    }
    return {name: float(value) for name, value in values.items()}


PARAMETERS = MugParameters


def canonical() -> Shape:
    """A plain cylindrical mug of the usual size with a D-shaped handle."""
    material = mug_finish.canonical_materials()
    return _assemble(MugParameters(), material)


def build(parameters: MugParameters, rng: np.random.Generator) -> Shape:
    """The mug of these parameters, in materials drawn from `rng`."""
    return _assemble(parameters, mug_finish.draw_materials(parameters, rng))


def _assemble(p: MugParameters, materials: mug_finish.MugMaterials) -> Shape:
    handle = _handle(p)
    # The ends of the bar lie inside the wall, where no picture or scan ever sees them.
    buried = np.zeros((2 * _QUARTER + 5, _RING + 1), bool)
    buried[:3], buried[-3:] = True, True
    parts = (
        Part.of("body", _body(p), materials.body),
        Part.of("handle", handle, materials.handle, ~buried.ravel()),
    )
    contents = (Part.of("drink", _drink(p), materials.drink),)
    return centred("mug", dataclasses.asdict(p), parts, contents)


def outer_radius(p: MugParameters, z: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
    """Radius of the outside at height z [m] above the foot, without bands and the rounded lower edge."""
    s = np.clip(z / p.height, 0, 1)
    # A bump that is 1 at belly_at and 0 at both ends.
    power = np.log(0.5) / np.log(p.belly_at)
    bump = np.sin(np.pi * s**power) ** 1.5
    flare = np.clip((s - 0.72) / 0.28, 0, 1) ** 2
    return p.radius * (p.base + (1 - p.base) * s**p.curve + p.belly * bump + p.lip * (flare - 0.0))


def _bands(p: MugParameters, z: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
    centres = np.linspace(0.5, 0.8, p.bands) if p.bands < 2 else np.linspace(0.12, 0.88, p.bands)
    return p.band_size * sum((np.exp(-(((z / p.height - c) / 0.03) ** 4)) for c in centres), np.zeros_like(z))


def _body(p: MugParameters) -> Surface:
    profile, v = _body_profile(p)
    return revolve(profile, COLUMNS, section=superellipse(COLUMNS, 1, 1, p.square), v=v)


def _body_profile(p: MugParameters) -> tuple[Float[np.ndarray, "r 2"], Float[np.ndarray, "r"]]:
    edge = p.bottom_round * p.radius
    low = float(outer_radius(p, np.array(p.foot))) - edge
    foot = low * (1 - p.foot_inset)
    recess = min(p.recess, 0.6 * p.floor + 0.6 * p.foot)
    under = [
        [0, recess],
        [0.5 * foot, recess],
        [foot - 0.005, recess],
        [foot - 0.0035, 0],
        [foot - 0.0008, 0],
    ]
    ring = [[foot, min(0.0006, 0.5 * p.foot)], [foot, p.foot]]
    angle = np.linspace(0, np.pi / 2, _ROUND + 1)
    z = p.foot + edge * (1 - np.cos(angle))
    rounding = np.stack([outer_radius(p, z) - edge * (1 - np.sin(angle)), z], -1)
    rim_centre = p.height - p.wall / 2
    z = np.linspace(z[-1], rim_centre, _WALL + 1)[1:]
    wall = np.stack([outer_radius(p, z) + _bands(p, z), z], -1)
    angle = np.linspace(0, np.pi, _RIM + 2)[1:-1]
    top = outer_radius(p, np.array(p.height))
    rim = np.stack([top - p.wall / 2 * (1 - np.cos(angle)), rim_centre + p.wall / 2 * np.sin(angle)], -1)
    inside = _inside_profile(p)
    v = [
        np.linspace(0, V_UNDER, len(under)),
        V_UNDER
        + (V_OUTSIDE - V_UNDER)
        * np.concatenate([[0.004, 0.01], rounding[:, 1] / p.height, wall[:, 1] / p.height]),
        np.linspace(V_OUTSIDE, V_RIM, _RIM + 2)[1:-1],
        np.linspace(V_RIM, V_INSIDE, _INSIDE),
        np.linspace(V_INSIDE, 1, len(inside) - _INSIDE + 1)[1:],
    ]
    return np.concatenate([under, ring, rounding, wall, rim, inside]), np.maximum.accumulate(
        np.concatenate(v)
    )


def _inside_profile(p: MugParameters) -> Float[np.ndarray, "r 2"]:
    """From the rim down the inside wall to the middle of the floor."""
    floor = p.foot + p.floor
    edge = max(p.bottom_round * p.radius, 0.004)
    angle = np.linspace(0, np.pi / 2, _FLOOR + 1)[1:]
    z = np.linspace(p.height - p.wall / 2, floor + edge, _INSIDE)
    wall = np.stack([outer_radius(p, z) - p.wall, z], -1)
    z = floor + edge * (1 - np.sin(angle))
    bottom = np.stack([outer_radius(p, z) - p.wall - edge * (1 - np.cos(angle)), z], -1)
    return np.concatenate([wall, bottom, [[0.5 * bottom[-1, 0], floor], [0, floor]]])


def _drink(p: MugParameters) -> Surface:
    """What is in the mug: the inside up to the level, a hair off the wall."""
    profile = _inside_profile(p)[::-1].copy()
    bottom = profile[0, 1]
    level = bottom + p.fill * (p.height - p.wall - bottom)
    gap = 0.0004
    z = np.minimum(profile[:, 1] + gap, level)
    radius = np.interp(z, profile[2:, 1] + gap, profile[2:, 0]) - gap
    radius[:2] = profile[:2, 0]
    filled = np.concatenate([np.stack([radius, z], -1), [[0.0, level]]])
    return revolve(filled, COLUMNS, section=superellipse(COLUMNS, 1, 1, p.square))


def _handle_path(p: MugParameters) -> Float[np.ndarray, "r 3"]:
    """Centre line from the upper to the lower end, both on the outer wall."""
    margin = 0.6 * p.thickness * (1 + p.root)
    z_top = min(p.handle_top * p.height, p.height - margin - 0.0005)
    z_bottom = max(p.handle_bottom * p.height, p.foot + margin)
    z_peak = z_bottom + p.peak * (z_top - z_bottom)
    quarters = []
    for end, exponent, reverse in ((z_top, p.square_top, False), (z_bottom, p.square_bottom, True)):
        angle = np.linspace(np.pi / 2, 0, 200)
        off = p.reach * np.cos(angle) ** (2 / exponent)
        z = z_peak + (end - z_peak) * np.abs(np.sin(angle)) ** (2 / exponent)
        share = off / p.reach
        z += (end - z_peak) * p.swell * 4 * share * (1 - share)
        off *= 1 + p.tilt * (z - z_peak) / (z_top - z_bottom) * 2
        if reverse:
            off += p.gap * p.reach * np.clip(1 - 2 * share, 0, 1)
        points = resample(np.stack([off, z], -1), _QUARTER)
        quarters.append(points[::-1] if reverse else points)
    line = np.concatenate([quarters[0], quarters[1][1:]])
    ends = outer_radius(p, np.array([z_bottom, z_top]))
    x = np.interp(line[:, 1], [z_bottom, z_top], ends) + line[:, 0]
    return np.stack([x, np.zeros(len(x)), line[:, 1]], -1)


def _handle(p: MugParameters) -> Surface:
    path = _handle_path(p)
    along = np.linspace(-1, 1, len(path))
    size = 1 - p.pinch * (1 - along**2) + p.root * np.abs(along) ** 8
    sections = superellipse(_RING, p.thickness / 2, p.width / 2, p.bar) * size[:, None, None]
    rings = sweep(path, sections).vertices.reshape(-1, _RING + 1, 3)[2:-2, :-1].copy()
    top, bottom = _on_wall(p, rings[0], 0.0), _on_wall(p, rings[-1], 0.0)
    rings[0] = top
    first, last = _on_wall(p, rings[0], 0.5 * p.wall), rings[-1] + (0, 0, 0)
    if p.gap == 0:
        rings[-1] = bottom
        last = _on_wall(p, rings[-1], 0.5 * p.wall)
    else:
        last[:, 2] -= 1e-4  # a free end needs its last ring too: the topology is the same for all
    ends = [np.broadcast_to(ring.mean(0), ring.shape)[None] for ring in (first, last)]
    return tube(
        np.concatenate([ends[0], first[None], rings, last[None], ends[1]]), creases=(1, len(path) + 2)
    )


def _on_wall(p: MugParameters, points: Float[np.ndarray, "m 3"], depth: float) -> Float[np.ndarray, "m 3"]:
    """The points moved along x onto the outer wall, or `depth` [m] inside it."""
    radius = outer_radius(p, points[:, 2]) - depth
    across = np.clip(np.abs(points[:, 1]) / radius, 0, 0.99)
    return np.stack([radius * (1 - across**p.square) ** (1 / p.square), points[:, 1], points[:, 2]], -1)
