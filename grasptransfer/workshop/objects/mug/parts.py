"""Surfaces of a mug's parts, one function each; the ground is z = 0, the mug's axis x = y = 0."""

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.mug.finish import V_INSIDE, V_OUTSIDE, V_RIM, V_UNDER
from grasptransfer.workshop.objects.mug.parameters import MugParameters
from grasptransfer.workshop.objects.surfaces import PartSurface, resample, revolve, superellipse, sweep, tube

COLUMNS = 48
_ROUND, _WALL, _RIM, _INSIDE, _FLOOR = 5, 28, 5, 11, 5  # rows of the body's regions
HANDLE_QUARTER, HANDLE_RING = 13, 14  # handle: rows from an end to the outermost point, columns


def outer_radius(p: MugParameters, z: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """Radius of the outside at height z [m] above the foot, without bands and the rounded lower edge."""
    s = np.clip(z / p.height, 0, 1)
    # A bump that is 1 at belly_at and 0 at both ends.
    power = np.log(0.5) / np.log(p.belly_at)
    bump = np.sin(np.pi * s**power) ** 1.5
    flare = np.clip((s - 0.72) / 0.28, 0, 1) ** 2
    return p.radius * (p.base + (1 - p.base) * s**p.curve + p.belly * bump + p.lip * flare)


def _bands(p: MugParameters, z: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    centres = np.linspace(0.5, 0.8, p.bands) if p.bands < 2 else np.linspace(0.12, 0.88, p.bands)
    return p.band_size * sum((np.exp(-(((z / p.height - c) / 0.03) ** 4)) for c in centres), np.zeros_like(z))


def body(p: MugParameters) -> PartSurface:
    profile, v = _body_profile(p)
    return revolve(profile, COLUMNS, section=superellipse(COLUMNS, 1, 1, p.square), v=v)


def _body_profile(p: MugParameters) -> tuple[Float[np.ndarray, "r 2"], Float[np.ndarray, "r"]]:
    edge = p.bottom_round * p.radius
    low = outer_radius(p, np.array([p.foot]))[0] - edge
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
    top = outer_radius(p, np.array([p.height]))[0]
    rim = np.stack([top - p.wall / 2 * (1 - np.cos(angle)), rim_centre + p.wall / 2 * np.sin(angle)], -1)
    inside = _inside_profile(p)
    outside = np.concatenate([[0.004, 0.01], rounding[:, 1] / p.height, wall[:, 1] / p.height])
    v = [
        np.linspace(0, V_UNDER, len(under)),
        V_UNDER + (V_OUTSIDE - V_UNDER) * outside,
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


def drink(p: MugParameters) -> PartSurface:
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
            off = p.gap * p.reach + (1 - p.gap) * off
        points = resample(np.stack([off, z], -1), HANDLE_QUARTER)
        quarters.append(points[::-1] if reverse else points)
    line = np.concatenate([quarters[0], quarters[1][1:]])
    ends = outer_radius(p, np.array([z_bottom, z_top]))
    x = np.interp(line[:, 1], [z_bottom, z_top], ends) + line[:, 0]
    return np.stack([x, np.zeros(len(x)), line[:, 1]], -1)


def handle(p: MugParameters) -> PartSurface:
    path = _handle_path(p)
    along = np.linspace(-1, 1, len(path))
    size = 1 - p.pinch * (1 - along**2) + p.root * np.abs(along) ** 8
    sections = superellipse(HANDLE_RING, p.thickness / 2, p.width / 2, p.bar) * size[:, None, None]
    rings = sweep(path, sections).vertices.reshape(-1, HANDLE_RING + 1, 3)[2:-2, :-1].copy()
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
