"""Sizes of cameras: what they mean, and the ranges of the families that a random one comes from."""

from dataclasses import dataclass, replace

import numpy as np

_RANGES = {
    "width": (0.112, 0.132),
    "height": (0.062, 0.076),
    "depth": (0.028, 0.038),
    "corner": (0.006, 0.018),
    "edge": (0.002, 0.006),
    "shoulder": (0.002, 0.014),
    "shoulder_drop": (0.002, 0.012),
    "lens_y": (-0.002, 0.012),
    "lens_z": (-0.006, 0.0),
    "lens_radius": (0.027, 0.034),
    "lens_length": (0.02, 0.075),
    "lens_taper": (0.86, 1.08),
    "lens_waist": (0.84, 1.0),
    "lens_recess": (0.003, 0.01),
    "grip_depth": (0.002, 0.015),
    "grip_width": (0.02, 0.034),
    "grip_height": (0.8, 0.95),
    "hump_height": (0.006, 0.015),
    "hump_width": (0.03, 0.044),
    "hump_taper": (0.45, 0.85),
    "hump_overhang": (-0.004, 0.006),
    "button_radius": (0.0045, 0.0075),
    "dial_radius": (0.007, 0.0105),
    "dial_height": (0.003, 0.008),
    "screen": (0.5, 0.85),
}
_COMPACT = {
    "width": (0.086, 0.112),
    "height": (0.052, 0.066),
    "depth": (0.019, 0.034),
    "corner": (0.004, 0.015),
    "shoulder": (0.002, 0.016),
    "lens_y": (0.0, 0.02),
    "lens_z": (-0.005, 0.002),
    "lens_radius": (0.016, 0.026),
    "lens_length": (0.005, 0.034),
    "lens_taper": (0.62, 0.9),
    "grip_depth": (0.0008, 0.005),
    "grip_width": (0.01, 0.02),
    "button_radius": (0.004, 0.007),
    "dial_radius": (0.005, 0.009),
    "dial_height": (0.0015, 0.004),
}
_DSLR = {
    "width": (0.122, 0.15),
    "height": (0.074, 0.094),
    "depth": (0.042, 0.06),
    "corner": (0.008, 0.02),
    "edge": (0.004, 0.009),
    "shoulder": (0.01, 0.024),
    "shoulder_drop": (0.008, 0.026),
    "lens_y": (0.002, 0.016),
    "lens_z": (-0.008, -0.001),
    "lens_radius": (0.031, 0.041),
    "lens_length": (0.03, 0.11),
    "grip_depth": (0.012, 0.028),
    "grip_width": (0.028, 0.042),
    "hump_height": (0.014, 0.026),
    "hump_width": (0.038, 0.056),
    "hump_overhang": (0.0, 0.016),
    "dial_height": (0.005, 0.009),
}
_FAMILIES = {
    "mirrorless": (0.22, {}),
    "compact": (0.24, _COMPACT),
    "dslr": (0.24, _DSLR),
    "rangefinder": (
        0.1,
        {"shoulder": (0.001, 0.006), "corner": (0.01, 0.018), "grip_depth": (0.0008, 0.005)},
    ),
    "bridge": (
        0.1,
        _DSLR
        | {
            "width": (0.108, 0.13),
            "height": (0.066, 0.08),
            "depth": (0.036, 0.05),
            "lens_length": (0.045, 0.1),
            "lens_radius": (0.028, 0.036),
            "hump_height": (0.01, 0.018),
        },
    ),
    "box": (
        0.1,
        _COMPACT
        | {
            "width": (0.09, 0.13),
            "height": (0.085, 0.125),
            "depth": (0.04, 0.068),
            "corner": (0.006, 0.022),
            "edge": (0.003, 0.012),
            "shoulder": (0.004, 0.03),
            "shoulder_drop": (0.004, 0.03),
            "lens_y": (-0.008, 0.008),
            "lens_z": (-0.022, -0.004),
            "lens_radius": (0.022, 0.036),
            "lens_length": (0.01, 0.03),
            "grip_width": (0.014, 0.026),
            "grip_depth": (0.0008, 0.01),
        },
    ),
}
_WITHOUT_HUMP = ("compact", "rangefinder", "box")


@dataclass(frozen=True)
class CameraParameters:
    """Sizes of a camera; the ranges that `draw` uses stand in `_RANGES` and `_FAMILIES`.

    Args:
        width (y), height (z), depth (x): of the body [m].
        corner: radius of its upright edges [m]. edge: of its rims, seen from the side [m].
        shoulder, shoulder_drop: how far its upper corners are cut, across and downwards, seen from ahead [m].
        lens_y, lens_z: of the lens's axis from the body's centre [m].
        lens_radius, lens_length: [m]. lens_taper: radius at the front, lens_waist: of the barrel behind
            its ring, as shares. lens_recess: depth of the glass in it [m].
        grip_depth: how far the grip stands out ahead, grip_width [m]. grip_height: share of the body's.
        hump_height: of the viewfinder over the body, 0 without; hump_width, hump_overhang: to the front [m].
            hump_taper: width on top as a share.
        button_radius, dial_radius, dial_height: [m]. dials: how many, 0 to 2.
        flash: "front", "hump" (not seen) or "corner". window: whether a viewfinder window is ahead.
        shoe: whether there is a hot shoe. screen: its width as a share of the body's.
    """

    width: float = 0.124
    height: float = 0.07
    depth: float = 0.036
    corner: float = 0.011
    edge: float = 0.004
    shoulder: float = 0.009
    shoulder_drop: float = 0.008
    lens_y: float = 0.006
    lens_z: float = -0.003
    lens_radius: float = 0.031
    lens_length: float = 0.044
    lens_taper: float = 0.97
    lens_waist: float = 0.93
    lens_recess: float = 0.006
    grip_depth: float = 0.011
    grip_width: float = 0.029
    grip_height: float = 0.88
    hump_height: float = 0.012
    hump_width: float = 0.041
    hump_taper: float = 0.62
    hump_overhang: float = 0.003
    button_radius: float = 0.006
    dial_radius: float = 0.009
    dial_height: float = 0.006
    dials: int = 1
    flash: str = "hump"
    window: bool = False
    shoe: bool = True
    screen: float = 0.65

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "CameraParameters":
        """Sizes of a random camera."""
        names, shares = list(_FAMILIES), [share for share, _ in _FAMILIES.values()]
        family = names[rng.choice(len(names), p=shares)]
        ranges = _RANGES | _FAMILIES[family][1]
        drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
        humped = family not in _WITHOUT_HUMP
        if not humped:
            drawn["hump_height"] = 0.0
        if family == "dslr" and rng.random() < 0.12:  # no lens on it
            drawn["lens_length"] = float(rng.uniform(0.006, 0.012))
        # The lens ends within the front, or a little below it.
        drawn["lens_radius"] = min(drawn["lens_radius"], 0.47 * drawn["height"])
        spare = drawn["height"] / 2 - 1.06 * drawn["lens_radius"]
        drawn["lens_z"] = max(drawn["lens_z"], -spare - 0.002)
        return replace(
            cls(),
            **drawn,
            dials=int(rng.choice(3, p=[0.15, 0.5, 0.35])),
            flash="hump" if humped else str(rng.choice(["front", "corner"], p=[0.7, 0.3])),
            window=bool(rng.random() < (0.05 if humped else 0.45)),
            shoe=bool(rng.random() < (0.8 if humped else 0.35)),
        )

    @property
    def front(self) -> float:
        """Where the body's front lies [m]; x = 0 in the middle of the body."""
        return self.depth / 2

    @property
    def grip_y(self) -> float:
        """Middle of the grip [m], at the camera's right hand: -y."""
        return -(self.width / 2 - self.grip_width / 2 - 0.3 * self.edge)
