"""How drills are coloured: makers' colours, dark rubber, bare metal, names and types."""

from dataclasses import dataclass

import numpy as np

from grasptransfer.workshop.objects.labels import draw_name
from grasptransfer.workshop.objects.textures import (
    BLACK,
    WHITE,
    Colour,
    contrast,
    draw_colour,
    hsv,
    luminance,
    shade,
)

# Hue, saturation and value that makers of drills use.
_MAKERS = (
    *((0.04, 0.95, 0.92), (0.13, 0.95, 0.96), (0.5, 0.95, 0.55), (0.0, 0.9, 0.72), (0.36, 0.7, 0.3)),
    *((0.6, 0.85, 0.55), (0.25, 0.75, 0.7), (0.06, 0.85, 0.95), (0.0, 0.0, 0.78), (0.0, 0.0, 0.2)),
)
_TYPES = (
    "18V",
    "14.4V",
    "12V",
    "20V MAX",
    "10.8V",
    "Li-ion",
    "LITHIUM",
    "XR",
    "36V",
    "PRO 18",
    "1500 W",
    "GX",
)


@dataclass(frozen=True)
class DrillFinish:
    """How a drill is coloured.

    Args:
        kind: "printed" has textures; "flat" one colour a part; "scan" is one colour all over.
        shell, rubber, accent: sRGB colours of the shells, the grips and the print.
        chuck, battery, trigger: sRGB colours.
        metal_chuck: whether the chuck is bare metal.
        brand, type_name: what is printed on.
        grip: how far the rubber extends around the handle. nose, bumper: dark share of the housing's
            ends.
        vents: slits at the housing's rear. wear: 0 new to 1 battered.
        gloss: roughness of the shells. seed: of grain and scratches.
    """

    kind: str
    shell: Colour
    rubber: Colour
    accent: Colour
    chuck: Colour
    battery: Colour
    trigger: Colour
    metal_chuck: bool
    brand: str
    type_name: str
    grip: float
    nose: float
    bumper: float
    vents: int
    wear: float
    gloss: float
    seed: int

    @classmethod
    def typical(cls) -> "DrillFinish":
        """Orange and black."""
        shell, dark = hsv(0.045, 0.92, 0.88), (38, 38, 40)
        colours = (shell, dark, WHITE, (46, 46, 48), dark, (28, 28, 30))
        return cls("printed", *colours, False, "DARO", "18V", 0.22, 0.2, 0.0, 4, 0.1, 0.5, 3)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "DrillFinish":
        """A random finish."""
        hue, saturation, value = _MAKERS[rng.integers(len(_MAKERS))]
        shell = hsv(
            hue + rng.normal(0, 0.012), saturation * rng.uniform(0.85, 1), value * rng.uniform(0.8, 1.05)
        )
        if rng.random() < 0.2:
            shell = draw_colour(rng)
        rubber = hsv(rng.random(), rng.uniform(0, 0.15), rng.uniform(0.1, 0.28))
        if luminance(shell) < 60 and rng.random() < 0.6:
            rubber = contrast(shell, rng)
        metal = bool(rng.random() < 0.25)
        chuck = hsv(rng.random(), 0.04, rng.uniform(0.5, 0.8) if metal else rng.uniform(0.08, 0.3))
        battery = [rubber, rubber, shell, shade(shell, 0.75)][rng.integers(4)]
        trigger = [BLACK, rubber, hsv(0.0, 0.85, 0.75)][rng.choice(3, p=[0.5, 0.35, 0.15])]
        kind = str(rng.choice(["printed", "flat", "scan"], p=[0.68, 0.14, 0.18]))
        names = draw_name(rng).upper(), str(rng.choice(_TYPES))
        nose = rng.uniform(0.1, 0.42) if rng.random() < 0.5 else 0.0
        bumper = rng.uniform(0.06, 0.2) if rng.random() < 0.5 else 0.0
        wear = rng.uniform(0, 0.8) if rng.random() < 0.5 else 0.0
        colours = shell, rubber, contrast(shell, rng), chuck, battery, trigger
        dark = float(rng.uniform(0.1, 0.3)), float(nose), float(bumper)
        last = int(rng.integers(0, 8)), float(wear), float(rng.uniform(0.3, 0.75)), int(rng.integers(2**31))
        return cls(kind, *colours, metal, *names, *dark, *last)
