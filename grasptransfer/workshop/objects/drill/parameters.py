"""Sizes of drills: what they mean, and the ranges of the families that a random drill comes from."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

_RANGES = {
    "body_length": (0.105, 0.145),
    "body_height": (0.054, 0.07),
    "slimness": (0.82, 1.08),
    "squareness": (2.0, 3.4),
    "rear_size": (0.74, 1.02),
    "rear_drop": (-0.007, 0.009),
    "rear_round": (0.008, 0.028),
    "front_size": (0.72, 1.04),
    "overhang": (0.038, 0.086),
    "pitch": (-0.5, 4.0),
    "clutch_length": (0.008, 0.03),
    "clutch_size": (0.72, 0.95),
    "chuck_length": (0.036, 0.066),
    "chuck_radius": (0.016, 0.024),
    "chuck_nose": (0.32, 0.82),
    "switch_rise": (-0.004, 0.0028),
    "handle_length": (0.075, 0.11),
    "handle_depth": (0.033, 0.049),
    "handle_width": (0.026, 0.04),
    "rake": (-2.0, 16.0),
    "swell": (-0.002, 0.006),
    "throat": (-0.003, 0.022),
    "trigger_length": (0.02, 0.038),
    "trigger_reach": (0.007, 0.023),
    "foot_length": (0.095, 0.128),
    "foot_width": (0.058, 0.084),
    "foot_forward": (0.45, 1.08),
    "foot_flare": (0.016, 0.042),
    "foot_curve": (0.12, 1.3),
    "foot_slope": (-0.18, 0.25),
    "foot_tilt": (-2.0, 2.0),
    "battery_height": (0.03, 0.064),
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
            "body_height": (0.06, 0.084),
            "rear_size": (0.92, 1.12),
            "rear_drop": (0.0, 0.016),
            "clutch_length": (0.014, 0.036),
            "foot_length": (0.1, 0.14),
            "foot_width": (0.07, 0.086),
            "battery_height": (0.036, 0.074),
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
            "handle_depth": (0.036, 0.053),
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
        switch_rise: of the gear switch out of the housing's top [m], below 0 hidden.
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
    switch_rise: float = 0.0015
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
        if rng.random() < 0.12:
            drawn["foot_tilt"] = rng.uniform(-8, 8)
        if rng.random() < 0.1:
            drawn["pitch"] = rng.uniform(4, 16)
        drill = replace(cls(), **{name: float(value) for name, value in drawn.items()})
        excess = max(drill.foot_front - drill.chuck_tip + 0.004, 0.0)  # the foot ends behind the chuck
        return replace(
            drill, foot_forward=drill.foot_forward - excess / (drill.foot_length - drill.handle_depth)
        )

    @property
    def foot_height(self) -> float:
        """Where the handle begins [m above the ground]."""
        return self.battery_height + self.foot_flare

    @property
    def housing_height(self) -> float:
        """Height of the housing's axis over the handle [m above the ground]."""
        return self.foot_height + self.handle_length + self.body_height / 2

    @property
    def chuck_tip(self) -> float:
        """How far the chuck reaches ahead along the housing's axis [m]."""
        return self.body_length - self.overhang + self.clutch_length + self.chuck_length

    @property
    def foot_front(self) -> float:
        """How far the foot reaches ahead [m]."""
        spare = self.foot_length - self.handle_depth
        return float(self.handle_x(self.foot_height)) + self.handle_depth / 2 + self.foot_forward * spare

    def handle_x(self, z: float | Float[np.ndarray, "*r"]) -> float | Float[np.ndarray, "*r"]:
        """Where the handle's axis runs [m]; x = 0 at the housing's axis."""
        return -np.tan(np.radians(self.rake)) * (self.housing_height - z)
