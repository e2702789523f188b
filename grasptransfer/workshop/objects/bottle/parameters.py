"""The parameters of a bottle and their ranges, kind by kind."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np


@dataclass(frozen=True)
class BottleParameters:
    """What makes one bottle; metres, or shares as said. `draw` knows the ranges of each kind.

    Args:
        kind: decides on materials: one of `KINDS`.
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
        kind = str(rng.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
        ranges = {**_COMMON, **KINDS[kind][1]}
        values: dict[str, Any] = {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}
        half = values["half_width"] = values.get("half_width", values.pop("slim", 0) * values["height"])
        if "cap_share" in values:  # wide caps follow the body, and the neck follows the cap
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


_COMMON = {
    "depth": (1.0, 1.0),
    "square": (2.0, 2.0),
    "shoulder_round": (1.6, 2.4),
    "shoulder_soft": (0.1, 0.8),
    "neck_radius": (0.0115, 0.0145),
    "neck_taper": (0.9, 1.02),
    "taper": (0.96, 1.03),
    "depth_taper": (0.96, 1.02),
    "waist": (-0.02, 0.02),
    "waist_at": (0.35, 0.65),
    "waist_size": (0.12, 0.35),
    "bottom_round": (0.06, 0.3),
    "punt": (0.03, 0.3),
    "ring": (0.0002, 0.0015),
    "cap_height": (0.012, 0.020),
    "cap_over": (0.0015, 0.0030),
    "cap_taper": (0.93, 1.0),
    "cap_oval": (0.0, 0.0),
    "cap_round": (0.0005, 0.002),
    "dome": (0.0002, 0.001),
    "nozzle_share": (0.2, 0.35),
    "nozzle_height": (0.0003, 0.0003),
    "nozzle_taper": (0.8, 1.0),
    "fill": (0.15, 0.97),
}
_OVAL = {"depth": (0.5, 0.78), "square": (2.0, 3.2)}
_SPOUT = {"nozzle_share": (0.2, 0.34), "nozzle_height": (0.012, 0.022), "nozzle_taper": (0.45, 0.9)}
# Share of all bottles, and the ranges that differ from the common ones.
KINDS: dict[str, tuple[float, dict[str, tuple[float, float]]]] = {
    "water": (
        0.14,
        {"height": (0.18, 0.32), "slim": (0.13, 0.17), "shoulder": (0.58, 0.76), "neck": (0.82, 0.90)},
    ),
    "soda": (
        0.10,
        {
            **{
                "height": (0.20, 0.31),
                "slim": (0.125, 0.155),
                "shoulder": (0.42, 0.62),
                "neck": (0.84, 0.92),
            },
            **{"shoulder_soft": (0.5, 1.0), "waist": (0.0, 0.12), "waist_at": (0.4, 0.8)},
        },
    ),
    "wine": (
        0.12,
        {
            **{"height": (0.28, 0.33), "half_width": (0.036, 0.044), "shoulder": (0.52, 0.64)},
            **{"neck": (0.68, 0.76), "shoulder_soft": (0.3, 0.7), "neck_radius": (0.0135, 0.0165)},
            **{"punt": (0.2, 0.8), "ring": (0.0005, 0.002), "cap_height": (0.004, 0.012)},
            **{"cap_over": (-0.004, 0.001), "neck_taper": (0.85, 0.95), "bottom_round": (0.04, 0.12)},
        },
    ),
    "beer": (
        0.09,
        {
            **{
                "height": (0.185, 0.27),
                "slim": (0.125, 0.155),
                "shoulder": (0.48, 0.62),
                "neck": (0.68, 0.84),
            },
            **{"shoulder_soft": (0.4, 1.0), "neck_taper": (0.8, 0.95), "cap_height": (0.005, 0.007)},
            **{"cap_over": (0.002, 0.003), "cap_taper": (0.82, 0.9), "ring": (0.001, 0.002)},
        },
    ),
    "detergent": (
        0.09,
        {
            **{"height": (0.19, 0.29), "slim": (0.15, 0.22), "depth": (0.5, 0.9), "square": (2.4, 4.5)},
            **{"shoulder": (0.52, 0.74), "neck": (0.76, 0.86), "neck_radius": (0.013, 0.022)},
            **{"cap_height": (0.022, 0.045), "taper": (0.85, 1.05)},
        },
    ),
    "sauce": (
        0.11,
        {
            **{"height": (0.13, 0.20), "slim": (0.19, 0.25), **_OVAL, "taper": (0.62, 1.0)},
            **{"shoulder": (0.34, 0.68), "neck": (0.66, 0.80), "cap_share": (0.5, 0.75)},
            **{"cap_height": (0.018, 0.04), "cap_taper": (0.8, 1.0), "waist": (0.0, 0.12)},
        },
    ),
    "mustard": (
        0.06,
        {
            **{"height": (0.15, 0.20), "slim": (0.22, 0.26), "depth": (0.52, 0.7), "square": (2.0, 2.6)},
            **{
                "waist": (0.06, 0.2),
                "waist_size": (0.12, 0.22),
                "shoulder": (0.6, 0.7),
                "neck": (0.74, 0.78),
            },
            **{"cap_share": (0.38, 0.5), "cap_height": (0.012, 0.02), "dome": (0.004, 0.012), **_SPOUT},
        },
    ),
    "pill": (
        0.07,
        {
            **{"height": (0.075, 0.14), "slim": (0.20, 0.29), "square": (2.0, 3.2), "shoulder": (0.62, 0.74)},
            **{"neck": (0.78, 0.86), "cap_share": (0.68, 1.02), "cap_height": (0.013, 0.026)},
            **{"ring": (0.0001, 0.0005), "shoulder_soft": (0.0, 0.5)},
        },
    ),
    "shampoo": (
        0.09,
        {
            **{"height": (0.15, 0.23), "slim": (0.155, 0.20), **_OVAL, "taper": (0.75, 1.12)},
            **{
                "shoulder": (0.68, 0.84),
                "neck": (0.82, 0.9),
                "cap_oval": (0.6, 1.0),
                "cap_share": (0.6, 1.0),
            },
            **{"cap_height": (0.015, 0.038), "cap_taper": (0.85, 1.0), "waist": (-0.08, 0.08)},
        },
    ),
    "lotion": (
        0.05,
        {
            **{"height": (0.11, 0.21), "slim": (0.15, 0.23), "shoulder_round": (0.9, 2.2)},
            **{"shoulder_soft": (0.0, 0.2), "shoulder": (0.6, 0.76), "neck": (0.74, 0.84)},
            **{"cap_share": (0.35, 0.65), "cap_height": (0.018, 0.045), "cap_taper": (0.75, 1.0)},
        },
    ),
    "sport": (
        0.04,
        {
            **{"height": (0.18, 0.26), "slim": (0.14, 0.18), "shoulder": (0.66, 0.76), "neck": (0.78, 0.84)},
            **{"cap_share": (0.7, 1.0), "cap_height": (0.016, 0.03), "dome": (0.004, 0.015)},
            **{"nozzle_share": (0.25, 0.4), "nozzle_height": (0.012, 0.025), "cap_round": (0.001, 0.004)},
        },
    ),
    "baby": (
        0.02,
        {
            **{"height": (0.13, 0.2), "slim": (0.16, 0.2), "shoulder": (0.62, 0.68), "neck": (0.66, 0.72)},
            **{"cap_share": (0.9, 1.05), "cap_height": (0.014, 0.022), "dome": (0.006, 0.014), **_SPOUT},
        },
    ),
    "spirit": (
        0.02,
        {
            **{"height": (0.17, 0.28), "slim": (0.14, 0.2), "depth": (0.5, 1.0), "square": (3.0, 5.0)},
            **{
                "shoulder": (0.58, 0.7),
                "neck": (0.68, 0.78),
                "punt": (0.05, 0.4),
                "cap_height": (0.014, 0.035),
            },
            **{"shoulder_soft": (0.0, 0.4), "cap_over": (0.001, 0.006)},
        },
    ),
}
