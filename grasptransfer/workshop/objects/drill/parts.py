"""Surfaces of a drill's parts, one function each.

What lies on the housing's axis is made about x, with the rear end at x = -`overhang`; the rest stands on
the ground, z = 0, with the housing's axis above x = 0.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.drill.parameters import DrillParameters
from grasptransfer.workshop.objects.surfaces import (
    ALONG_X,
    PartSurface,
    circle,
    loft,
    revolve,
    rounded_box,
    smooth_step,
    superellipse,
    sweep,
)

_DOWN = -np.pi / 2  # seam of what lies along x: at its underside


def pitched(degrees: float) -> Float[np.ndarray, "3 3"]:
    """Turns x up towards z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def _bump(centre: float, width: float, x: Float[np.ndarray, "*r"]) -> Float[np.ndarray, "*r"]:
    return np.exp(-(((x - centre) / width) ** 2))


def _outline(p: DrillParameters, t: Float[np.ndarray, "r"]) -> tuple[Float[np.ndarray, "r"], ...]:
    """Half height, half width and middle height of the housing [m] at shares of its length."""
    size = p.rear_size + (1 - p.rear_size) * smooth_step(0, 0.45, t)
    size -= (1 - p.front_size) * smooth_step(0.5, 0.97, t)
    middle = -p.rear_drop * (1 - smooth_step(0, 0.6, t))
    return size * p.body_height / 2, size * p.slimness * p.body_height / 2, middle


def housing(p: DrillParameters) -> PartSurface:
    """Motor housing: rounded at the rear, narrower at the front."""
    corner = np.linspace(0, np.pi / 2, 6)[:-1]
    rounding = min(p.rear_round, p.body_height * 0.45)
    x = np.concatenate([rounding * (1 - np.cos(corner)), np.linspace(rounding, p.body_length, 16)])
    inset = np.concatenate([rounding * (1 - np.sin(corner)), np.zeros(16)])
    inset[-2:] += [0.0, 0.0015]
    half_height, half_width, middle = _outline(p, x / p.body_length)
    sections = superellipse(40, half_width - inset, half_height - inset, p.squareness, start=_DOWN)
    sections[..., 1] += middle[:, None]
    return loft(x - p.overhang, sections).placed(rotation=ALONG_X)


def _front(p: DrillParameters) -> tuple[float, float]:
    """Where the housing ends on the axis [m], and its radius there [m]."""
    return p.body_length - p.overhang, p.front_size * p.slimness * p.body_height / 2


def clutch(p: DrillParameters) -> PartSurface:
    """Ring of the torque clutch."""
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


def chuck(p: DrillParameters) -> PartSurface:
    """Keyless chuck: two ribbed sleeves, a tapered nose with a hole."""
    start = _front(p)[0] + p.clutch_length - 0.004
    along = np.array(
        [0, 0, 0.06, 0.3, 0.32, 0.36, 0.38, 0.64, 0.7, 0.8, 0.9, 0.97, 1.0, 1.0, 0.99, 0.86, 0.86]
    )
    nose = p.chuck_nose
    taper = 1 - (1 - nose) * smooth_step(0.62, 0.98, along[:13])
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


def bit(p: DrillParameters) -> PartSurface:
    """A screwdriver bit."""
    tip = p.chuck_tip
    start = tip - 0.12 * p.chuck_length - 0.004
    end = tip + p.bit if p.bit > 0 else tip - 0.1 * p.chuck_length  # without a bit, it hides in the chuck
    radius = min(0.2 * p.chuck_radius, 0.0035)
    along = np.array([0, 0, 0.3, 0.55, 0.6, 0.85, 1.0])
    size = np.array([0, 1, 1, 1, 0.72, 0.72, 0])
    return revolve(np.stack([radius * size, start + (end - start) * along], -1), 12).placed(rotation=ALONG_X)


def speed_switch(p: DrillParameters) -> PartSurface:
    """Gear switch on top of the housing."""
    t = np.array([0.45])
    half_height, _, middle = _outline(p, t)
    box = rounded_box((0.011, 0.0065, 0.005), radius=0.003, fillet=0.0015, corner=3, edge=2, rows=2)
    return box.placed(
        (t[0] * p.body_length - p.overhang, 0, middle[0] + half_height[0] + p.switch_rise - 0.005)
    )


def side_handle(p: DrillParameters) -> PartSurface:
    """Auxiliary handle towards +y."""
    reach = p.side_handle if p.side_handle > 0 else 0.3 * p.slimness * p.body_height
    share = 1.0 if p.side_handle > 0 else 0.3
    along = np.array([0, 0, 0.22, 0.24, 0.26, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0, 1.0])
    size = np.array([0, 0.7, 0.7, 1.3, 1.3, 0.85, 1, 1, 0.95, 1.1, 0.9, 0])
    profile = np.stack([0.0145 * share * size, reach * along], -1)
    sideways = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    start = _front(p)[0] - 0.022
    return revolve(profile, 24).placed((start, 0, -0.1 * p.body_height), sideways)


def handle(p: DrillParameters) -> PartSurface:
    """Pistol grip, widening into the housing and forward above the trigger."""
    s = np.linspace(0, 1, 22)
    low, high = p.foot_height - 0.004, p.housing_height - 0.1 * p.body_height
    z = low + (high - low) * s
    reached = (z - low) / (p.handle_length + 0.004)  # 1 at the housing's underside
    middle = p.handle_x(z)
    throat = min(p.throat, 0.9 * (p.body_length - p.overhang) - p.handle_depth / 2)
    waist = 0.06 * p.handle_depth * _bump(0.85, 0.12, reached)
    back = middle - p.handle_depth / 2 - p.swell * _bump(0.55, 0.22, reached) + waist
    back -= 0.25 * min(p.overhang, 0.05) * smooth_step(0.86, 1.15, reached)
    front = middle + p.handle_depth / 2 + 0.4 * p.swell * _bump(0.35, 0.15, reached)
    front += throat * smooth_step(0.7, 1.0, reached)
    width = p.handle_width / 2 * (1 + 0.06 * _bump(0.5, 0.25, reached) - 0.05 * _bump(0.85, 0.1, reached))
    width += (0.36 * p.slimness * p.body_height - p.handle_width / 2) * smooth_step(0.9, 1.25, reached)
    sections = superellipse(36, (front - back) / 2, width, 2.4)
    sections[..., 0] += ((front + back) / 2)[:, None]
    return loft(z, sections)


def trigger(p: DrillParameters) -> PartSurface:
    """Trigger, hollow in front."""
    s = np.linspace(0, 1, 11)
    high = p.foot_height + p.handle_length - 0.003
    z = high - p.trigger_length * (1 - s)
    hook = p.trigger_reach * (0.72 + 0.28 * np.cos(2 * np.pi * s) + 0.1 * s)
    end = np.sqrt(1 - np.clip(np.abs(2 * s - 1) - 0.75, 0, 1) ** 2 / 0.25**2 * 0.9)  # The ends are round.
    inside, outside = p.handle_x(z) + 0.2 * p.handle_depth, p.handle_x(z) + p.handle_depth / 2 + hook * end
    sections = superellipse(24, (outside - inside) / 2, 0.27 * p.handle_width * (0.85 + 0.15 * end), 3.0)
    sections[..., 0] += ((outside + inside) / 2)[:, None]
    return loft(z, sections)


def selector(p: DrillParameters) -> PartSurface:
    """Reversing switch: a bar across the handle."""
    z = p.foot_height + p.handle_length - 0.002
    box = rounded_box(
        (0.0075, 0.5 * p.handle_width + 0.0045, 0.0035), radius=0.002, fillet=0.001, corner=3, edge=2, rows=2
    )
    return box.placed((float(p.handle_x(z)) + 0.12 * p.handle_depth, 0, z))


def _foot_ends(p: DrillParameters) -> tuple[float, float]:
    """Rear and front end of the foot [m]."""
    return p.foot_front - p.foot_length, p.foot_front


def _tilted(p: DrillParameters, surface: PartSurface, lean: Float[np.ndarray, "v"]) -> PartSurface:
    """Shear the foot along z by the joint's slope (as far as `lean` says) and by its tilt."""
    along = surface.vertices[:, 0] - p.handle_x(p.foot_height)
    rise = np.tan(np.radians(p.foot_tilt)) - p.foot_slope * lean
    lift = np.stack([np.zeros_like(along), np.zeros_like(along), along * rise], -1)
    return replace(surface, vertices=surface.vertices + lift)


def foot(p: DrillParameters) -> PartSurface:
    """Shell between handle and battery."""
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
    return _tilted(p, surface, 1 - smooth_step(0.1, 0.9, share))


def battery(p: DrillParameters) -> PartSurface:
    """Battery, or the base plate of drills without one."""
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


def cord(p: DrillParameters) -> PartSurface:
    """Sleeve of the cord at the heel."""
    s = np.linspace(0, 1, 12)
    if p.cord > 0:
        start, reach, size = _foot_ends(p)[0] + 0.012, p.cord + 0.012, 1.0
    else:  # hides in the foot under the handle
        start, reach, size = p.handle_x(p.foot_height) + 0.004, 0.008, 0.4
    z = p.battery_height + 0.2 * p.foot_flare
    path = np.stack([start - reach * s, 0 * s, z - 0.2 * p.cord * s**2], -1)
    radius = np.where(s < 0.7, 0.0062 - 0.002 * s + 0.0005 * np.cos(np.arange(12) * np.pi), 0.0034)
    return sweep(path, size * radius[:, None, None] * circle(14))
