"""The parameters of a mug and their ranges, set to span the mugs that people own."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from grasptransfer.workshop.objects.recipe import load_recipe


@dataclass(frozen=True)
class MugParameters:
    """What makes one mug; metres, or shares as said. recipe.yaml holds the ranges.

    Args:
        height: height of the body.
        radius: radius of the body at the rim.
        base: radius at the bottom as a share of `radius`.
        curve: exponent of the way from base to rim: 1 a cone, below 1 a bowl, above 1 a trumpet.
        belly: bulge half-way up, share of `radius`; negative is a waist. belly_at: its height, share.
        lip: outward flare of the uppermost part, share of `radius`.
        bottom_round: radius of the lower edge, share of `radius`.
        foot, foot_inset: height of the foot ring, and how much narrower it is (share).
        recess: how far the underside is hollowed.
        wall, floor: thickness.
        square: exponent of the section: 2 round, 4 a rounded square.
        bands, band_size: raised rings around the body, and how far they stand out.
        handle_top, handle_bottom: heights of its ends, share of `height`.
        reach: how far the handle's centre line stands off the wall.
        peak: where it is furthest, share of the way from its lower to its upper end.
        square_top, square_bottom: exponents of its two quarters: 2 an arc, 5 a corner, 1.2 a straight slope.
        swell: how far it rises above and below its ends, share of its height.
        tilt: outward lean of its upper part (negative: of its lower part), share of `reach`.
        gap: 0 if the lower end meets the wall, else how far off it hangs, share of `reach`.
        thickness, width: of the bar, across and along the wall. bar: exponent of its section.
        pinch: how much narrower the bar is half-way, share. root: how much thicker at the wall, share.
        fill: level of what is in it, share of the inside; seen through glass only.
    """

    height: float = 0.095
    radius: float = 0.041
    base: float = 0.97
    curve: float = 1.0
    belly: float = 0.0
    belly_at: float = 0.5
    lip: float = 0.0
    bottom_round: float = 0.12
    foot: float = 0.001
    foot_inset: float = 0.04
    recess: float = 0.002
    wall: float = 0.0042
    floor: float = 0.006
    square: float = 2.0
    bands: int = 0
    band_size: float = 0.0
    handle_top: float = 0.80
    handle_bottom: float = 0.24
    reach: float = 0.028
    peak: float = 0.53
    square_top: float = 2.5
    square_bottom: float = 2.3
    swell: float = 0.04
    tilt: float = 0.0
    gap: float = 0.0
    thickness: float = 0.0085
    width: float = 0.0135
    bar: float = 2.4
    pinch: float = 0.05
    root: float = 0.12
    fill: float = 0.02

    @staticmethod
    def draw(rng: np.random.Generator) -> "MugParameters":
        """A plausible mug; straight, tapered, bellied, espresso, soup, latte or keg."""
        kind, drawn = load_recipe("mug").draw(rng)
        values: dict[str, Any] = {**drawn}
        values |= _draw_handle(rng, values["height"])
        if rng.random() < 0.55:  # Half of all mugs stand flat, without a visible foot.
            values |= {"foot": 0.0006, "foot_inset": 0.0}
        if rng.random() < 0.06:
            values["square"] = float(rng.uniform(2.6, 5))
        if rng.random() < (0.8 if kind == "keg" else 0.08):
            values |= {"bands": int(rng.integers(1, 4)), "band_size": float(rng.uniform(0.0006, 0.0022))}
        return MugParameters(**values)


def _draw_handle(rng: np.random.Generator, height: float) -> dict[str, float]:
    kind = rng.choice(["C", "D", "ear", "square", "hook"], p=[0.34, 0.26, 0.2, 0.17, 0.03])
    squares = {
        "C": ((1.8, 2.3), (1.8, 2.3)),
        "D": ((2.3, 3.5), (2.3, 3.5)),
        "ear": ((1.9, 3.6), (1.1, 1.7)),
        "square": ((3.5, 7.0), (3.5, 7.0)),
        "hook": ((4.0, 7.0), (3.0, 5.0)),
    }[str(kind)]
    top = rng.uniform(0.70, 0.95)
    bottom = rng.uniform(0.08, 0.42)
    values = {
        "handle_top": top,
        "handle_bottom": min(bottom, top - 0.36),
        "reach": float(np.clip(height * rng.uniform(0.18, 0.37), 0.014, 0.037)),
        "peak": rng.uniform(0.58, 0.82) if kind == "ear" else rng.uniform(0.38, 0.66),
        "square_top": rng.uniform(*squares[0]),
        "square_bottom": rng.uniform(*squares[1]),
        "swell": rng.uniform(-0.03, 0.2) if kind != "hook" else 0.0,
        "tilt": rng.normal(0.2 if kind == "ear" else 0.0, 0.16),
        "gap": rng.uniform(0.5, 0.9) if kind == "hook" else 0.0,
        "thickness": rng.uniform(0.0045, 0.0115) * (0.75 if height < 0.07 else 1),
        "width": rng.uniform(0.007, 0.019) * (0.75 if height < 0.07 else 1),
        "bar": rng.uniform(2.0, 4.5),
        "pinch": rng.uniform(-0.1, 0.3),
        "root": rng.uniform(0.0, 0.45),
        "fill": rng.uniform(0.4, 0.9) if rng.random() < 0.6 else 0.02,
    }
    return {name: float(value) for name, value in values.items()}
