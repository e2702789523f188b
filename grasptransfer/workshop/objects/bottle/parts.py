"""Surfaces of a bottle's parts, one function each; the ground is z = 0, the bottle's axis x = y = 0."""

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.bottle.finish import V_TOP, V_UNDER
from grasptransfer.workshop.objects.bottle.parameters import BottleParameters
from grasptransfer.workshop.objects.surfaces import PartSurface, superellipse, tube

COLUMNS, _CAP_COLUMNS = 40, 32
_ROUND, _BODY, _SHOULDER, _NECK, _LIQUID = 5, 46, 13, 6, 26  # rows of the regions
_FACTORS = np.array([0.0, 0.25, 0.5, 0.7, 0.82, 0.92])  # radii of the underside's rows, shares of its edge
_OPEN_CAP = 0.0015  # m: height of the disc that is left of the cap inside the bore of an open bottle


def _levels(p: BottleParameters) -> tuple[float, float, float, float]:
    """Heights [m] where the shoulder, the neck and the cap begin, and where the body ends."""
    if p.open:
        base, top = p.height - 0.016, p.height
    else:
        base = p.height - p.cap_height - p.dome - p.nozzle_height
        top = base + 0.75 * p.cap_height
    neck = min(p.neck * p.height, base - 0.001)
    return min(p.shoulder * p.height, neck - 0.004), neck, base, top


def half_sizes(
    p: BottleParameters, z: Float[np.ndarray, "m"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Half extents along x and y [m] and the section's exponent at heights z [m], up to the cap."""
    shoulder, neck, base, _ = _levels(p)
    s = np.clip(z / shoulder, 0, 1)
    waist = 1 - p.waist * np.exp(-(((s - p.waist_at) / p.waist_size) ** 2))
    edge = p.bottom_round * p.half_width * min(1.0, 2 * p.depth)
    low = np.clip(edge - z, 0, edge)
    inset = edge - np.sqrt(np.maximum(edge**2 - low**2, 0))
    if p.ribs:
        # Grooves between 12 and 88 % of the body, as deep at every rib.
        phase = np.clip((s - 0.12) / 0.76, 0, 1) * p.ribs
        inset = inset + p.rib_depth * 0.5 * (1 - np.cos(2 * np.pi * phase))
    t = np.clip((z - shoulder) / (neck - shoulder), 0, 1)
    arc = np.maximum(1 - t**p.shoulder_round, 0) ** (1 / p.shoulder_round)
    share = (1 - p.shoulder_soft) * arc + p.shoulder_soft * 0.5 * (1 + np.cos(np.pi * t))
    u = np.clip((z - neck) / (base - neck), 0, 1)
    round_neck = p.neck_radius * (1 + (p.neck_taper - 1) * u)
    # An oval cap sits on an oval neck.
    neck_x = round_neck * (1 - p.cap_oval * (1 - p.depth))
    half_y = p.half_width * (1 + (p.taper - 1) * s) * waist - inset
    half_x = p.half_width * p.depth * (1 + (p.depth_taper - 1) * s) * waist - inset
    neck_square = 2 + p.cap_oval * (p.square - 2)
    exponent = p.square * share + neck_square * (1 - share)
    return neck_x + (half_x - neck_x) * share, round_neck + (half_y - round_neck) * share, exponent


def _rings(
    columns: int,
    half_x: Float[np.ndarray, "r"],
    half_y: Float[np.ndarray, "r"],
    exponent: Float[np.ndarray, "r"],
    z: Float[np.ndarray, "r"],
) -> Float[np.ndarray, "r c 3"]:
    # The UV seam is at the back: u = 0.5 faces +x.
    flat = superellipse(columns, half_x, half_y, exponent, start=np.pi)
    return np.concatenate([flat, np.broadcast_to(z[:, None, None], (*flat.shape[:2], 1))], axis=2)


def _punt(p: BottleParameters) -> Float[np.ndarray, "r"]:
    """How far the underside is pushed in [m] at `_FACTORS`."""
    _, neck, _, _ = _levels(p)
    depth = min(p.punt * p.half_width * min(1.0, 1.5 * p.depth), 0.5 * neck)
    return depth * np.clip(1 - (_FACTORS / _FACTORS[-1]) ** 2, 0, 1) ** 0.8


def body(p: BottleParameters) -> PartSurface:
    shoulder, neck, base, top = _levels(p)
    edge = p.bottom_round * p.half_width * min(1.0, 2 * p.depth)
    lower = edge * (1 - np.cos(np.linspace(0, np.pi / 2, _ROUND + 1)))
    side = np.linspace(lower[-1], shoulder, _BODY + 1)[1:]
    slope = shoulder + (neck - shoulder) * np.sin(np.linspace(0, np.pi / 2, _SHOULDER + 1))[1:]
    ring_height = min(0.0016 + p.ring, 0.4 * (base - neck))
    rise = np.linspace(neck, base - 2 * ring_height, _NECK + 1)[1:]
    ring = base - ring_height * np.array([1.6, 1.2, 0.6, 0.2])
    z = np.concatenate([lower, side, slope, rise, ring])
    half_x, half_y, exponent = half_sizes(p, z)
    bump = np.zeros(len(z))
    bump[-4:] = p.ring * np.array([0.2, 1, 1, 0.2])
    outside = _rings(COLUMNS, half_x + bump, half_y + bump, exponent, z)
    under = _rings(COLUMNS, half_x[0] * _FACTORS, half_y[0] * _FACTORS, np.full(6, exponent[0]), _punt(p))
    # The finish under the cap, its lip and the bore.
    lip_x, lip_y = half_x[-1] * 0.96, half_y[-1] * 0.96
    bore = top - min(0.014, 0.6 * (top - neck))
    share = np.array([1.0, 1.0, 0.94, 0.74, 0.70, 0.0])
    height = np.array([base, top - 0.0006, top, top, bore, bore])
    finish = _rings(COLUMNS, lip_x * share, lip_y * share, np.full(6, exponent[-1]), height)
    v = [
        np.linspace(0, V_UNDER, len(_FACTORS), endpoint=False),
        V_UNDER + (V_TOP - V_UNDER) * np.concatenate([z, height[:2]]) / top,
        np.linspace(V_TOP, 1, 5)[1:],
    ]
    return tube(np.concatenate([under, outside, finish]), v=np.maximum.accumulate(np.concatenate(v)))


def cap(p: BottleParameters) -> PartSurface:
    radius, z = _cap_profile(p)
    aspect = 1 - p.cap_oval * (1 - p.depth)
    _, _, base, top = _levels(p)
    if p.open:  # what is left of the cap: a disc on the ground of the bore
        size = 0.5 * half_sizes(p, np.array([base]))[1][0]
        radius = radius / radius.max() * size
        z = top - min(0.014, 0.6 * (top - _levels(p)[1])) + _OPEN_CAP * z / z.max() - 0.5 * _OPEN_CAP
    else:
        z = base + z
    square = 2 + p.cap_oval * (p.square - 2) * np.clip(radius / p.cap_radius, 0, 1)
    v = np.concatenate([[0.0, 0.03, 0.05], np.linspace(0.06, 0.60, 6), np.linspace(0.62, 1.0, len(z) - 9)])
    return tube(_rings(_CAP_COLUMNS, radius * aspect, radius, square, z), v=v)


def _cap_profile(p: BottleParameters) -> tuple[Float[np.ndarray, "r"], Float[np.ndarray, "r"]]:
    """Radius and height above its lower edge [m] of each row of the cap."""
    edge = min(p.cap_round, 0.4 * p.cap_height, 0.4 * p.cap_radius)
    upper = p.cap_radius * p.cap_taper
    side = np.linspace(0, 1, 6)
    side_z = 0.0004 + side * (p.cap_height - edge - 0.0004)
    side_r = p.cap_radius + (upper - p.cap_radius) * side
    angle = np.linspace(0, np.pi / 2, 5)[1:]
    edge_r, edge_z = upper - edge * (1 - np.cos(angle)), p.cap_height - edge * (1 - np.sin(angle))
    nozzle = min(p.nozzle_radius, 0.8 * (upper - edge))
    angle = np.linspace(0, np.pi / 2, 7)[1:]
    dome_r = nozzle + (upper - edge - nozzle) * np.cos(angle)
    dome_z = p.cap_height + p.dome * np.sin(angle)
    roof = p.cap_height + p.dome
    tip = nozzle * p.nozzle_taper
    spout_r = [nozzle * 0.98, (nozzle + tip) / 2, tip, tip * 0.9, tip * 0.6, 0.0]
    spout_z = roof + p.nozzle_height * np.array([0.03, 0.5, 0.9, 0.98, 1.0, 1.0])
    radius = np.concatenate([[0, 0.6 * p.cap_radius, 0.985 * p.cap_radius], side_r, edge_r, dome_r, spout_r])
    return radius, np.concatenate([[0, 0, 0], side_z, edge_z, dome_z, spout_z])


def liquid(p: BottleParameters) -> PartSurface:
    """The inside up to the level, a wall's thickness off the outside."""
    _, neck, base, _ = _levels(p)
    wall = 0.0012
    bottom = wall + 0.15 * p.bottom_round * p.half_width
    level = bottom + p.fill * (0.5 * (neck + base) - bottom)
    z = bottom + (level - bottom) * np.linspace(0, 1, _LIQUID)
    half_x, half_y, exponent = half_sizes(p, z)
    rings = _rings(COLUMNS, half_x - wall, half_y - wall, exponent, z)
    arch = np.minimum(bottom + _punt(p), level)
    start = (half_x[0] - wall, half_y[0] - wall)
    under = _rings(COLUMNS, start[0] * _FACTORS, start[1] * _FACTORS, np.full(6, exponent[0]), arch)
    top = np.broadcast_to(rings[-1].mean(0), (1, COLUMNS, 3))
    return tube(np.concatenate([under, rings, top]), creases=(len(under) + _LIQUID - 1,))
