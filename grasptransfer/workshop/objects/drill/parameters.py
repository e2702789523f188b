"""Sizes of drills: what they mean, and the ranges of the families that a random drill comes from."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.workshop.objects.recipe import load_recipe


@dataclass(frozen=True)
class DrillParameters:
    """Sizes of a drill; their ranges stand in recipe.yaml.

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
        _, drawn = load_recipe("drill").draw(rng)
        if rng.random() < 0.12:
            drawn["bit"] = rng.uniform(0.008, 0.025)
        if rng.random() < 0.12:
            drawn["foot_tilt"] = rng.uniform(-8, 8)
        if rng.random() < 0.1:
            drawn["pitch"] = rng.uniform(4, 16)
        drill = replace(cls(), **{name: float(value) for name, value in drawn.items()})
        excess = max(drill.foot_front - drill.chuck_tip + 0.004, 0.0)  # The foot ends behind the chuck.
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
        """Position of the chuck's tip along the housing's axis [m]."""
        return self.body_length - self.overhang + self.clutch_length + self.chuck_length

    @property
    def foot_front(self) -> float:
        """Position of the foot's front end along x [m]."""
        spare = self.foot_length - self.handle_depth
        return float(self.handle_x(self.foot_height)) + self.handle_depth / 2 + self.foot_forward * spare

    def handle_x(self, z: float | Float[np.ndarray, "*r"]) -> float | Float[np.ndarray, "*r"]:
        """Where the handle's axis runs [m]; x = 0 at the housing's axis."""
        return -np.tan(np.radians(self.rake)) * (self.housing_height - z)
