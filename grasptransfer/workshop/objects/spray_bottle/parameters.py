"""Sizes of spray bottles: what they mean, and the ranges of the families that a random one comes from."""

from dataclasses import dataclass, replace

import numpy as np

from grasptransfer.workshop.objects.recipe import load_recipe


@dataclass(frozen=True)
class SprayBottleParameters:
    """Sizes of a spray bottle; their ranges stand in recipe.yaml.

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
        head_front, head_rear: extent of the head from the neck's axis [m]. head_height, head_width (half)
            [m].
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
        family, drawn = load_recipe("spray_bottle").draw(rng)
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
