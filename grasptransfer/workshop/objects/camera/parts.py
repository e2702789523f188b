"""Surfaces of a camera's parts, one function each; the body is centred at the origin, the lens along +x."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.camera.parameters import CameraParameters
from grasptransfer.workshop.objects.surfaces import (
    ALONG_X,
    PartSurface,
    circle,
    loft,
    revolve,
    rounded_box,
    rounded_rectangle,
    superellipse,
)

_DOWN = -np.pi / 2  # seam of what lies along x: at its underside
_CORNER, _EDGE = 5, 6


def body(p: CameraParameters) -> PartSurface:
    """The box; u runs by arc length from the middle of the back, so that the front is about u = 0.5."""
    arc = np.linspace(0, np.pi / 2, 6)[:-1]
    half = p.height / 2
    z = np.concatenate(
        [
            -half + p.edge * (1 - np.cos(arc)),
            np.linspace(p.edge - half, half - p.shoulder_drop, 7)[:-1],
            half - p.shoulder_drop * (1 - np.sin(np.linspace(0, np.pi / 2, 8))),
        ]
    )
    below, above = (
        np.clip((p.edge - half - z) / p.edge, 0, 1),
        np.clip((z - half) / p.shoulder_drop + 1, 0, 1),
    )
    rim = np.clip((z - half) / p.edge + 1, 0, 1)
    inset_x = p.edge * (2 - np.sqrt(1 - below**2) - np.sqrt(1 - rim**2))
    inset_y = p.edge * (1 - np.sqrt(1 - below**2)) + p.shoulder * (1 - np.sqrt(1 - above**2))
    radius = np.maximum(min(p.corner, 0.48 * p.depth) - inset_x, 1e-3)
    sections = np.stack(
        [
            rounded_rectangle(p.depth / 2 - x, p.width / 2 - y, r, corner=_CORNER, edge=_EDGE)
            for x, y, r in zip(inset_x, inset_y, radius, strict=True)
        ]
    )
    return _unrolled(loft(z, sections), sections[8])


def _unrolled(surface: PartSurface, outline: Float[np.ndarray, "c 2"]) -> PartSurface:
    """The surface with u by arc length along `outline`."""
    steps = np.linalg.norm(np.diff(outline, axis=0, append=outline[:1]), axis=1)
    u = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    rows = len(surface.vertices) // len(u)
    return replace(surface, uv=np.stack([np.tile(u, rows), surface.uv[:, 1]], -1))


def grip(p: CameraParameters) -> PartSurface:
    """What the right hand holds; on slim cameras a ledge."""
    arc = np.linspace(0, np.pi / 2, 5)[:-1]
    low = -p.height / 2 + 0.6 * p.edge
    high = low + p.grip_height * (p.height - p.edge)
    round_low, round_high = 0.3 * p.edge + 0.0015, min(0.5 * p.grip_depth + 0.003, 0.012)
    z = np.concatenate(
        [
            low + round_low * (1 - np.cos(arc)),
            np.linspace(low + round_low, high - round_high, 8)[:-1],
            high - round_high * (1 - np.sin(np.linspace(0, np.pi / 2, 5))),
        ]
    )
    s = (z - low) / (high - low)
    rounding = np.sqrt(1 - np.clip((z - high) / round_high + 1, 0, 1) ** 2)
    out = p.grip_depth * (0.85 + 0.15 * np.sin(np.pi * s)) * (0.35 + 0.65 * rounding)
    out = out * (1 - 0.25 * (1 - np.clip((z - low) / round_low, 0, 1)) ** 2)
    inside = 0.3 * p.depth
    half_x, half_y = (out + inside) / 2, p.grip_width / 2 * (0.9 + 0.1 * rounding)
    sections = superellipse(32, half_x, half_y, 2.8)
    sections += np.stack([p.front - inside + half_x, np.full_like(half_x, p.grip_y)], -1)[:, None]
    return loft(z, sections)


def hump(p: CameraParameters) -> PartSurface:
    """Housing of the viewfinder's prism over the lens; without one, it hides in the body."""
    top = p.height / 2 + (p.hump_height if p.hump_height > 0 else -0.3 * p.height)
    low = top - max(p.hump_height, 0.004) - min(0.3 * p.height, 0.02)
    share = 1.0 if p.hump_height > 0 else 0.6
    z = np.concatenate([np.linspace(low, top - 0.004, 9), top - 0.004 * (1 - np.sin([0.5, 1.0, 1.3, 1.57]))])
    rim = 0.004 * (1 - np.sqrt(1 - np.clip((z - top) / 0.004 + 1, 0, 1) ** 2))
    s = np.clip((z - low) / (top - low), 0, 1)
    begins = np.clip((z - p.height / 2) / max(p.hump_height, 0.004), 0, 1)
    half_y = share * p.hump_width / 2 * (1 - (1 - p.hump_taper) * begins**1.2)
    front = 0.42 * p.depth + p.hump_overhang * np.sin(np.pi * np.clip(0.3 + 0.5 * begins, 0, 1)) * share
    back = -0.42 * p.depth + 0.1 * p.depth * s
    sections = superellipse(32, (front - back) / 2 - rim, half_y - rim, 5.0)
    sections += np.stack([(front + back) / 2, np.full_like(z, p.lens_y)], -1)[:, None]
    return loft(z, sections)


def lens(p: CameraParameters) -> PartSurface:
    """Mount, barrel with its ribbed rings, and the rim around the glass; v by the way along the outside."""
    length, recess = p.lens_length, min(p.lens_recess, 0.7 * p.lens_length)
    along = np.array(
        [0.0, 0.0, 0.1, 0.12, 0.14, 0.3, 0.32, 0.35, 0.62, 0.65, 0.7, 0.74, 0.93, 0.96, 0.985, 1.0]
    )
    radius = np.interp(along, [0, 0.12, 0.16, 0.5, 1], [1.06, 1.06, p.lens_waist, 1.0, 1.0])
    radius = radius * np.interp(along, [0, 0.2, 1], [1, 1, p.lens_taper])
    radius[[4, 6, 10]] *= 0.965
    radius[[0, -1]] *= [0, 0.975]
    inner = p.lens_taper * np.array([0.86, 0.8, 0.7, 0.62, 0.0])
    x = np.concatenate([length * along, length - recess * np.array([0.0, 0.15, 0.55, 1.0, 1.0])])
    profile = np.stack([p.lens_radius * np.concatenate([radius, inner]), x], -1)
    profile[:2, 1] = -0.25 * p.depth
    sections = np.repeat(circle(48, _DOWN)[None], len(profile), axis=0)
    depth = 0.012 * min(1.0, length / 0.05)  # Ribs on a short steep barrel would be spikes.
    ripple = (1 + depth * np.cos(np.arange(48) * np.pi))[:, None]
    sections[7:9] *= ripple
    sections[11:13] *= ripple
    v = np.concatenate(
        [[0.0, 0.02], np.interp(along[2:], [0, 1], [0.03, 0.8]), [0.84, 0.87, 0.92, 0.97, 1.0]]
    )
    surface = revolve(profile, 48, section=sections, v=v, creases=(1, 3, 15, 16))
    return surface.placed((p.front, p.lens_y, p.lens_z), ALONG_X)


def glass(p: CameraParameters) -> PartSurface:
    """The front element."""
    recess = min(p.lens_recess, 0.7 * p.lens_length)
    radius, bulge = 0.64 * p.lens_radius * p.lens_taper, 0.55 * recess
    t = np.linspace(0, np.pi / 2, 7)
    cap = np.stack([radius * np.cos(t), bulge * np.sin(t)], -1)
    profile = np.concatenate([[[0, -0.002], [radius, -0.002]], cap])
    at = p.front + p.lens_length - recess
    return revolve(profile, 32, start=_DOWN, creases=(1,)).placed((at, p.lens_y, p.lens_z), ALONG_X)


def _knob(radius: float, height: float, columns: int) -> PartSurface:
    """An upright knob that extends 3 mm below its origin."""
    chamfer = min(0.0012, 0.3 * height)
    profile = np.array(
        [
            *((0, -0.003), (radius, -0.003), (radius, 0.2 * height), (radius, height - chamfer)),
            *((radius - 0.4 * chamfer, height - 0.3 * chamfer), (radius - chamfer, height), (0, height)),
        ]
    )
    sections = np.repeat(circle(columns)[None], len(profile), axis=0)
    sections[2:4] *= (1 + 0.02 * np.cos(np.arange(columns) * np.pi))[:, None]
    return revolve(profile, columns, section=sections, creases=(1, 5))


def _deck(p: CameraParameters, y: float) -> float:
    """Height of the body's top at `y` [m]."""
    over = np.clip((abs(y) - p.width / 2) / p.shoulder + 1, 0, 1)
    return p.height / 2 - p.shoulder_drop * (1 - np.sqrt(1 - over**2))


def button(p: CameraParameters) -> PartSurface:
    """Shutter release, over the grip."""
    y = max(p.grip_y + 0.2 * p.grip_width, p.button_radius + 0.8 * p.shoulder - p.width / 2)
    return _knob(p.button_radius, 0.0026, 24).placed((0.12 * p.depth, y, _deck(p, y - p.button_radius)))


def mode_dial(p: CameraParameters) -> PartSurface:
    """Dial on the right of the top; hidden in the body if there is none."""
    y = 0.5 * (p.lens_y - p.hump_width / 2 + p.grip_y) - 0.002
    return _placed_dial(p, y, p.dial_radius, shown=p.dials > 0)


def second_dial(p: CameraParameters) -> PartSurface:
    """Dial on the left of the top; hidden in the body if there is none."""
    y = 0.5 * (p.lens_y + p.hump_width / 2 + p.width / 2 - 0.5 * p.shoulder)
    return _placed_dial(p, y, 0.9 * p.dial_radius, shown=p.dials > 1)


def _placed_dial(p: CameraParameters, y: float, radius: float, *, shown: bool) -> PartSurface:
    outer = y + np.sign(y) * radius
    z = _deck(p, outer) if shown else -p.dial_height
    return _knob(min(radius, 0.42 * p.depth), p.dial_height, 32).placed((-0.1 * p.depth, y, z))


def _box(
    half_size: tuple[float, float, float], place: tuple[float, float, float], *, shown: bool = True
) -> PartSurface:
    """A small box; one that is not shown sits in the middle of the body."""
    if not shown:
        half_size, place = tuple(np.minimum(half_size, 0.004)), (0.0, 0.0, 0.0)
    fillet = 0.25 * min(half_size)
    return rounded_box(half_size, radius=2 * fillet, fillet=fillet, corner=3, edge=2, rows=2).placed(place)


def flash(p: CameraParameters) -> PartSurface:
    """Window of the flash at the upper left of the front, large on box cameras."""
    large = p.flash == "corner"
    half_y, half_z = (0.014, 0.0085) if large else (0.0085, 0.0038)
    beside_lens = p.width / 2 - 0.6 * p.shoulder - 0.003 - (p.lens_y + 1.08 * p.lens_radius)
    half_y = float(np.clip(beside_lens / 2, 0.005, half_y))
    y = p.width / 2 - 0.6 * p.shoulder - half_y - 0.002
    z = p.height / 2 - max(0.35 * p.shoulder_drop, p.edge) - half_z - 0.003
    return _box((0.003, half_y, half_z), (p.front - 0.0018, y, z), shown=p.flash != "hump")


def window(p: CameraParameters) -> PartSurface:
    """Viewfinder window at the top of the front."""
    y = p.lens_y - 0.45 * p.lens_radius
    z = p.height / 2 - p.edge - 0.0065
    return _box((0.003, 0.0062, 0.0042), (p.front - 0.0019, y, z), shown=p.window)


def shoe(p: CameraParameters) -> PartSurface:
    """Hot shoe on top of all."""
    z = p.height / 2 + p.hump_height + 0.0005
    return _box((0.009, 0.0092, 0.0018), (-0.12 * p.depth, p.lens_y, z), shown=p.shoe)


def screen(p: CameraParameters) -> PartSurface:
    """Screen at the back."""
    half_y = p.screen * p.width / 2 * 0.8
    half_z = min(0.42 * p.height, 0.75 * half_y)
    return _box((0.0025, half_y, half_z), (-p.front - 0.0002, 0.08 * p.width, -0.03 * p.height))


def eyepiece(p: CameraParameters) -> PartSurface:
    """Rubber around the eyepiece at the back of the hump."""
    z = p.height / 2 + 0.25 * p.hump_height
    place = (-0.42 * p.depth - 0.003, p.lens_y, z)
    return _box((0.007, 0.3 * p.hump_width, 0.4 * p.hump_height + 0.004), place, shown=p.hump_height > 0)
