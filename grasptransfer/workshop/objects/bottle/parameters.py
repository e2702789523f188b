"""The parameters of a bottle and their ranges, kind by kind."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from grasptransfer.workshop.objects.recipe import load_recipe


@dataclass(frozen=True)
class BottleParameters:
    """What makes one bottle; metres, or shares as said. recipe.yaml holds the ranges of each kind.

    Args:
        kind: decides on materials: a family of recipe.yaml.
        height: in all, with the cap.
        half_width: half the body's extent along y.
        depth: extent along x as a share of that along y.
        square: exponent of the body's section: 2 round, 4 a rounded rectangle.
        shoulder, neck: heights where the shoulder and where the neck begin, share of `height`.
        shoulder_round: exponent of the shoulder's arc: 2 round, 1 a cone.
        shoulder_soft: 0 the arc as it is, 1 an S that runs smoothly into the neck.
        neck_radius: at its lower end. neck_taper: radius at its upper end as a share of that.
        taper, depth_taper: width and depth at the shoulder as shares of those at the bottom.
        waist: how much narrower the body is at its waist, share; negative is a belly.
        waist_at, waist_size: its height and its spread, share of the body's height.
        bottom_round: radius of the lower edge, share of `half_width`.
        punt: how far the underside is pushed in, share of `half_width`.
        ribs, rib_depth: grooves around the body.
        ring: how far the ring at the top of the neck stands out.
        cap_height, cap_radius, cap_taper: of the cap; taper is its upper radius as a share of the lower.
        cap_oval: 0 a round cap, 1 one with the body's section. cap_round: radius of its upper edge.
        dome: how far the cap's top rises to its middle.
        nozzle_radius, nozzle_height, nozzle_taper: of a spout on the cap.
        open: whether the bottle has no cap.
        fill: level of the liquid, share of the height below the neck's top.
    """

    kind: str = "water"
    height: float = 0.215
    half_width: float = 0.033
    depth: float = 1.0
    square: float = 2.0
    shoulder: float = 0.64
    neck: float = 0.84
    shoulder_round: float = 2.0
    shoulder_soft: float = 0.5
    neck_radius: float = 0.0125
    neck_taper: float = 1.0
    taper: float = 1.0
    depth_taper: float = 1.0
    waist: float = 0.0
    waist_at: float = 0.5
    waist_size: float = 0.2
    bottom_round: float = 0.15
    punt: float = 0.15
    ribs: int = 0
    rib_depth: float = 0.0
    ring: float = 0.001
    cap_height: float = 0.017
    cap_radius: float = 0.0150
    cap_taper: float = 0.97
    cap_oval: float = 0.0
    cap_round: float = 0.001
    dome: float = 0.0003
    nozzle_radius: float = 0.004
    nozzle_height: float = 0.0003
    nozzle_taper: float = 0.9
    open: bool = False
    fill: float = 0.85

    @staticmethod
    def draw(rng: np.random.Generator) -> "BottleParameters":
        """A plausible bottle of a random kind."""
        kind, drawn = load_recipe("bottle").draw(rng)
        values: dict[str, Any] = {**drawn}
        half = values["half_width"] = values.get("half_width", values.pop("slim", 0) * values["height"])
        if "cap_share" in values:  # Wide caps follow the body, and the neck follows the cap.
            values["cap_radius"] = values.pop("cap_share") * half * values["taper"]
            values["neck_radius"] = values["cap_radius"] * rng.uniform(0.80, 0.94) - 0.0005
        else:
            values["cap_radius"] = values["neck_radius"] * values["neck_taper"] + values["cap_over"]
        values["nozzle_radius"] = values.pop("nozzle_share") * values["cap_radius"]
        _draw_details(kind, values, rng)
        names = {field.name for field in fields(BottleParameters)}
        return BottleParameters(kind=kind, **{name: value for name, value in values.items() if name in names})


def _draw_details(kind: str, values: dict, rng: np.random.Generator) -> None:
    """What a bottle either has or has not."""
    if kind in ("water", "soda", "sport") and rng.random() < 0.6:
        values |= {"ribs": int(rng.integers(2, 10)), "rib_depth": float(rng.uniform(0.0006, 0.0022))}
    if kind in ("water", "sport", "detergent") and rng.random() < 0.4:
        values |= {"waist": float(rng.uniform(0.03, 0.13)), "waist_size": float(rng.uniform(0.1, 0.3))}
    if kind in ("detergent", "sauce", "water", "shampoo") and rng.random() < 0.25:
        values["nozzle_height"] = float(rng.uniform(0.006, 0.018))  # a sports or squeeze spout
        values["nozzle_radius"] = float(rng.uniform(0.25, 0.45)) * values["cap_radius"]
    if kind == "wine" and rng.random() < 0.45:  # Burgundy: a long slope instead of shoulders
        values["shoulder"], values["neck"] = float(rng.uniform(0.28, 0.46)), float(rng.uniform(0.70, 0.84))
        values["shoulder_soft"] = float(rng.uniform(0.7, 1))
    values["open"] = bool(kind in ("water", "soda", "wine", "beer", "spirit") and rng.random() < 0.15)
