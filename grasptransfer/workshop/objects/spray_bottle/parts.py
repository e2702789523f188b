"""Surfaces of a spray bottle's parts, one function each; the neck's axis is x = y = 0, the ground z = 0."""

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.spray_bottle.parameters import SprayBottleParameters
from grasptransfer.workshop.objects.surfaces import (
    ALONG_X,
    PartSurface,
    circle,
    loft,
    revolve,
    smooth_step,
    superellipse,
    sweep,
)

_DOWN = -np.pi / 2  # seam of what lies along x: at its underside
_COLUMNS = 40


def _outline(p: SprayBottleParameters) -> tuple[Float[np.ndarray, "r"], Float[np.ndarray, "r c 2"]]:
    """Heights [m] and outlines of the body; each row keeps its anatomical place on every bottle."""
    fillet = min(p.base_fillet, 0.4 * p.half_y)
    begin = p.shoulder * p.body_height
    top = min(p.shoulder + p.shoulder_height, 0.93) * p.body_height
    arc = np.linspace(0, np.pi / 2, 4)[:-1]
    z = np.concatenate(
        [
            fillet * (1 - np.cos(arc)),
            np.linspace(fillet, begin, 10)[:-1],
            np.linspace(begin, top, 9)[:-1],
            np.linspace(top, p.body_height, 13),
            [p.body_height + 0.4 * p.collar_height],
        ]
    )
    inset = np.concatenate([fillet * (1 - np.sin(arc)), np.zeros(len(z) - 3)])
    belly = (
        1 - p.taper * np.clip(z / begin, 0, 1) - p.waist * np.exp(-(((z / begin - p.waist_at) / 0.22) ** 2))
    )
    grip = p.neck_radius * (1 + (p.grip_size - 1) * (1 - smooth_step(top, p.body_height, z)))
    front = _edge(p, z, begin, top, p.half_x * belly - inset, grip)
    ridge = p.ridges * np.cos(6 * np.pi * (z - top) / (p.body_height - top))
    front += (
        np.where(z > top, ridge, p.ridges)
        * smooth_step(begin, top, z)
        * (1 - smooth_step(0.9, 1.0, z / p.body_height))
    )
    back = _edge(p, z, begin * (1 - p.back_lead), top, p.half_x * belly - inset, grip)
    width = _edge(p, z, begin, top, p.half_y * belly - inset, grip)
    middle = p.grip_shift * smooth_step(0.8 * begin, top, z) * (1 - smooth_step(top, p.body_height, z))
    exponent = 2 + (p.squareness - 2) * (1 - smooth_step(begin, top, z))
    sections = superellipse(_COLUMNS, (front + back) / 2, width, exponent)
    sections[..., 0] += (middle + (front - back) / 2)[:, None]
    return z, sections


def _edge(
    p: SprayBottleParameters,
    z: Float[np.ndarray, "r"],
    begin: float,
    top: float,
    belly: Float[np.ndarray, "r"],
    grip: Float[np.ndarray, "r"],
) -> Float[np.ndarray, "r"]:
    """Distance of an edge from the axis [m]: the belly's, then over the shoulder to the grip's."""
    t = np.clip((z - begin) / (top - begin), 0, 1)
    fall = (1 - t**p.shoulder_round) ** (2 / (1 + p.shoulder_round))
    return grip + (belly - grip) * fall


def body(p: SprayBottleParameters) -> PartSurface:
    """The bottle up into the collar; u = 0 in front, 0.25 on the left (+y)."""
    return loft(*_outline(p))


def liquid(p: SprayBottleParameters) -> PartSurface:
    """What is in it, up to its level."""
    z, sections = _outline(p)
    level = max(p.level * p.body_height, 0.02)
    heights = np.linspace(0.002, level, 24)
    inside = np.stack([np.interp(heights, z, column) for column in sections.reshape(len(z), -1).T], -1)
    inside = inside.reshape(24, *sections.shape[1:])
    middle = inside.mean(axis=1, keepdims=True)
    return loft(heights, middle + 0.955 * (inside - middle), creases=(23,))


def dip_tube(p: SprayBottleParameters) -> PartSurface:
    """The tube that sucks from the bottom."""
    s = np.linspace(0, 1, 14)
    path = np.stack([0.35 * p.half_x * (1 - s) ** 2, 0 * s, 0.006 + (p.body_height - 0.004) * s], -1)
    return sweep(path, np.broadcast_to(0.0026 * circle(10), (14, 10, 2)))


def collar(p: SprayBottleParameters) -> PartSurface:
    """The ribbed screw ring."""
    along = np.array([0, 0, 0.06, 0.12, 0.5, 0.85, 0.94, 1, 1])
    size = np.array([0, 1.2, 1.26, 1.26, 1.24, 1.2, 1.12, 1.02, 0])
    profile = np.stack([p.neck_radius * size, p.body_height - 0.001 + p.collar_height * along], -1)
    sections = np.repeat(circle(48)[None], len(along), axis=0)
    sections[3:6] *= (1 + 0.018 * np.cos(np.arange(48) * np.pi))[:, None]
    return revolve(profile, 48, section=sections, creases=(1, 7))


def stem(p: SprayBottleParameters) -> PartSurface:
    """From the collar up into the head."""
    low, high = p.body_height + 0.8 * p.collar_height, p.head_z + 0.45 * p.head_height
    s = np.linspace(0, 1, 9)
    half_x = p.neck_radius * (0.98 - 0.12 * smooth_step(0, 0.5, s))
    half_y = half_x + (p.head_width * 0.92 - half_x) * smooth_step(0.1, 0.8, s)
    return loft(low + (high - low) * s, superellipse(28, half_x, half_y, 2.3))


def head(p: SprayBottleParameters) -> PartSurface:
    """The trigger head's shroud, from its round rear to the nose."""
    corner = np.linspace(0.12, np.pi / 2, 6)[:-1]
    rear = min(0.012, 0.6 * p.head_rear)
    x = np.concatenate(
        [
            -p.head_rear + rear * (1 - np.sin(np.pi / 2 - corner)),
            np.linspace(rear - p.head_rear, p.head_front, 14),
        ]
    )
    rounding = np.concatenate([np.sin(corner), np.ones(14)]) ** 0.8
    t = np.clip(x / p.head_front, 0, 1)
    top = p.head_z + p.head_height - p.nose_drop * smooth_step(0.1, 1.0, t)
    top -= 0.2 * p.nose_drop * smooth_step(0, p.head_rear, -x)
    low = p.head_z + p.rear_low * smooth_step(0.006, p.head_rear, -x)
    low += (p.nozzle_z - p.nose_height / 2 - p.head_z) * smooth_step(0.2, 0.8, t)
    low = np.minimum(low, top - 0.008)
    width = p.head_width * (1 - 0.18 * smooth_step(0.2, 1, t) - 0.12 * smooth_step(0, p.head_rear, -x))
    middle, half = (top + low) / 2, (top - low) / 2
    half = half * rounding
    sections = superellipse(28, width * rounding, half, 3.0, start=_DOWN)
    sections[..., 1] += middle[:, None]
    return loft(x, sections).placed(rotation=ALONG_X)


def nozzle(p: SprayBottleParameters) -> PartSurface:
    """The turning cap in front, with its hole."""
    along = np.array([-0.3, -0.3, 0.0, 0.04, 0.1, 0.9, 0.97, 1.0, 1.0, 0.8, 0.8])
    size = np.array([0, 0.8, 0.8, 0.8, 1.0, 0.94, 0.9, 0.82, 0.34, 0.3, 0])
    profile = np.stack([p.nozzle_radius * size, p.head_front - 0.002 + p.nozzle_length * along], -1)
    square = superellipse(28, 1.0, 1.0, p.nozzle_squareness, start=_DOWN)
    surface = revolve(profile, 28, section=square, creases=(1, 8, 9)).placed(rotation=ALONG_X)
    return surface.placed((0, 0, p.nozzle_z))


def lever(p: SprayBottleParameters) -> PartSurface:
    """The trigger: a bowed strip that hangs below the nose."""
    s = np.linspace(0, 1, 14)
    lean = np.radians(p.lever_lean)
    away = p.lever_bow * (4 * (s - 0.45) ** 2 - 0.8)  # The lever is hollow where the fingers pull.
    start_x, start_z = p.lever_at * p.head_front, p.nozzle_z - 0.1 * p.nose_height
    x = start_x + p.lever_length * s * np.sin(lean)
    x += away - away[0]
    z = start_z - (p.lever_length + 0.004) * s * np.cos(lean)
    end = np.sqrt(np.clip(1 - (np.clip(s - 0.86, 0, 1) / 0.15) ** 2, 0.05, 1))
    thick = 0.0027 * (1.35 - 0.5 * s) * end
    wide = p.lever_width / 2 * (0.8 + 0.3 * smooth_step(0.1, 0.5, s)) * (0.4 + 0.6 * end)
    sections = superellipse(20, thick, wide, 3.0)
    return sweep(np.stack([x, 0 * s, z], -1), sections)
