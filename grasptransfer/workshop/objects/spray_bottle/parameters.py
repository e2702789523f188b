"""Sizes of spray bottles: what they mean, and the ranges of the families that a random one comes from."""

from dataclasses import dataclass, replace

import numpy as np

_RANGES = {
    "half_x": (0.031, 0.046),
    "half_y": (0.026, 0.038),
    "squareness": (2.2, 4.5),
    "body_height": (0.15, 0.215),
    "taper": (-0.08, 0.14),
    "waist": (0.0, 0.1),
    "waist_at": (0.3, 0.7),
    "shoulder": (0.45, 0.75),
    "shoulder_height": (0.12, 0.35),
    "shoulder_round": (1.0, 2.6),
    "back_lead": (0.0, 0.25),
    "grip_size": (1.0, 1.6),
    "grip_shift": (-0.008, 0.004),
    "ridges": (0.0, 0.0022),
    "base_fillet": (0.003, 0.012),
    "neck_radius": (0.0115, 0.0145),
    "collar_height": (0.014, 0.022),
    "stem_height": (0.0, 0.014),
    "head_front": (0.032, 0.056),
    "head_rear": (0.014, 0.04),
    "head_height": (0.024, 0.04),
    "head_width": (0.009, 0.0135),
    "rear_low": (-0.004, 0.02),
    "nose_drop": (0.002, 0.014),
    "nose_height": (0.013, 0.019),
    "nozzle_length": (0.009, 0.02),
    "nozzle_radius": (0.0075, 0.011),
    "nozzle_squareness": (2.0, 6.0),
    "lever_length": (0.042, 0.07),
    "lever_at": (0.5, 0.85),
    "lever_lean": (-10.0, 22.0),
    "lever_bow": (0.002, 0.01),
    "lever_width": (0.008, 0.014),
    "level": (0.25, 0.8),
}
_FAMILIES = {
    "oval": (0.3, {}),
    "pistol_neck": (
        0.28,
        {
            "half_x": (0.037, 0.05),
            "shoulder": (0.35, 0.55),
            "shoulder_height": (0.08, 0.2),
            "shoulder_round": (1.6, 3.0),
            "back_lead": (0.1, 0.35),
            "grip_size": (1.1, 1.7),
            "ridges": (0.0005, 0.003),
            "grip_shift": (-0.012, 0.0),
        },
    ),
    "round": (
        0.27,
        {
            "half_x": (0.027, 0.043),
            "squareness": (2.0, 2.0),
            "shoulder": (0.55, 0.85),
            "shoulder_height": (0.1, 0.3),
            "back_lead": (0.0, 0.0),
            "grip_size": (1.0, 1.15),
            "grip_shift": (0.0, 0.0),
            "ridges": (0.0, 0.0),
            "body_height": (0.105, 0.205),
        },
    ),
    "cone": (
        0.15,
        {
            "half_x": (0.036, 0.052),
            "squareness": (2.0, 3.2),
            "taper": (0.05, 0.25),
            "shoulder": (0.2, 0.45),
            "shoulder_height": (0.4, 0.6),
            "shoulder_round": (1.0, 1.3),
            "ridges": (0.0, 0.001),
            "grip_size": (1.0, 1.3),
        },
    ),
}


@dataclass(frozen=True)
class SprayBottleParameters:
    """Sizes of a spray bottle; the ranges that `draw` uses stand in `_RANGES` and `_FAMILIES`.

    Args:
        half_x, half_y: half the belly's extents [m]. squareness: of its outline, 2 round to 5 square.
        body_height: from the ground to the collar [m]. base_fillet: radius of the foot's edge [m].
        taper: how much narrower the belly is on top than at the base, as a share.
        waist: depth of the waist as a share, waist_at: its height as a share of the belly's.
        shoulder: where it begins, shoulder_height: how much it takes, as shares of `body_height`.
        shoulder_round: 1 conical to 3 round. back_lead: how much earlier it begins at the back, as a share.
        grip_size: radius over the shoulder as a multiple of the neck's. grip_shift: of it along x [m].
        ridges: depth of the finger ridges at the front of the grip [m].
        neck_radius, collar_height: [m]. stem_height: from the collar to the head [m].
        head_front, head_rear: reach of the head from the neck's axis [m]. head_height, head_width (half) [m].
        rear_low: height of the head's rear underside over its lowest place [m].
        nose_drop: fall of the head's top towards the nozzle [m]. nose_height: of its front [m].
        nozzle_length, nozzle_radius [m]. nozzle_squareness: 2 round to 6 square.
        lever_length [m]. lever_at: where it hangs, as a share of `head_front`. lever_width [m].
        lever_lean: from straight down, forward [degrees]. lever_bow: depth of its curve [m].
        level: height of the liquid as a share of the body's, seen in clear bottles.
    """

    half_x: float = 0.039
    half_y: float = 0.031
    squareness: float = 2.7
    body_height: float = 0.185
    taper: float = 0.03
    waist: float = 0.03
    waist_at: float = 0.5
    shoulder: float = 0.56
    shoulder_height: float = 0.2
    shoulder_round: float = 1.8
    back_lead: float = 0.1
    grip_size: float = 1.3
    grip_shift: float = -0.002
    ridges: float = 0.0012
    base_fillet: float = 0.007
    neck_radius: float = 0.013
    collar_height: float = 0.018
    stem_height: float = 0.006
    head_front: float = 0.043
    head_rear: float = 0.027
    head_height: float = 0.031
    head_width: float = 0.011
    rear_low: float = 0.006
    nose_drop: float = 0.006
    nose_height: float = 0.016
    nozzle_length: float = 0.014
    nozzle_radius: float = 0.009
    nozzle_squareness: float = 4.0
    lever_length: float = 0.056
    lever_at: float = 0.66
    lever_lean: float = 6.0
    lever_bow: float = 0.006
    lever_width: float = 0.011
    level: float = 0.6

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "SprayBottleParameters":
        """Sizes of a random spray bottle."""
        names, shares = list(_FAMILIES), [share for share, _ in _FAMILIES.values()]
        family = names[rng.choice(len(names), p=shares)]
        ranges = _RANGES | _FAMILIES[family][1]
        drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
        # Nobody makes them much wider than long; round ones are round.
        drawn["half_y"] = drawn["half_x"] if family == "round" else min(drawn["half_y"], drawn["half_x"])
        size = float(np.exp(rng.normal(0, 0.06)))
        lengths = ("half_x", "half_y", "body_height")
        return replace(cls(), **(drawn | {name: size * drawn[name] for name in lengths}))

    @property
    def head_z(self) -> float:
        """Underside of the head at the neck [m above the ground]."""
        return self.body_height + self.collar_height + self.stem_height

    @property
    def nozzle_z(self) -> float:
        """Height of the nozzle's axis [m above the ground]."""
        return self.head_z + self.head_height - self.nose_drop - self.nose_height / 2
