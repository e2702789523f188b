"""Sizes of cameras: what they mean, and the ranges of the families that a random one comes from."""

from dataclasses import dataclass, replace

import numpy as np

from grasptransfer.workshop.objects.recipe import load_recipe

_WITHOUT_HUMP = ("compact", "rangefinder", "box")


@dataclass(frozen=True)
class CameraParameters:
    """Sizes of a camera; their ranges stand in recipe.yaml.

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
        family, drawn = load_recipe("camera").draw(rng)
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
