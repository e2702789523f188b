"""Colours, labels and materials of spray bottles: opaque, clear with a coloured liquid, or plain."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from grasptransfer.workshop.objects.labels import label
from grasptransfer.workshop.objects.shape import Material
from grasptransfer.workshop.objects.textures import (
    BLACK,
    WHITE,
    Colour,
    draw_colour,
    gradient,
    grained,
    hsv,
    paste,
    patch_size,
    shade,
    worn,
)

_PARTS = ("body", "collar", "stem", "head", "nozzle", "lever")
_SIDES = (0.25, 0.75)  # u of the left and of the right
_SIZE = (512, 320)


@dataclass(frozen=True)
class SprayBottleFinish:
    """How a spray bottle is coloured.

    Args:
        kind: "opaque", "clear", "flat" (one colour a part) or "scan" (one colour all over).
        body, head, nozzle, lever, collar, liquid: sRGB colours.
        opacity: opacity of clear plastic, in [0, 1].
        labels: "sides", "around", "shrunk" (a printed sleeve all over) or "none".
        wear: 0 new to 1 battered. gloss: roughness of the plastic. seed: of labels and grain.
    """

    kind: str
    body: Colour
    head: Colour
    nozzle: Colour
    lever: Colour
    collar: Colour
    liquid: Colour
    opacity: float
    labels: str
    wear: float
    gloss: float
    seed: int

    @classmethod
    def typical(cls) -> "SprayBottleFinish":
        """A white bottle with a blue head and a label on both sides."""
        blue = (38, 84, 168)
        colours = (WHITE, blue, WHITE, blue, blue, hsv(0.55, 0.5, 0.9))
        return cls("opaque", *colours, 1.0, "sides", 0.0, 0.45, 11)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "SprayBottleFinish":
        """A random finish."""
        kind = str(rng.choice(["opaque", "clear", "flat", "scan"], p=[0.42, 0.26, 0.16, 0.16]))
        body = draw_colour(rng) if rng.random() < 0.65 else WHITE
        head = (WHITE, BLACK, body, draw_colour(rng), hsv(rng.random(), 0.85, 0.75))[rng.integers(5)]
        nozzle = (head, WHITE, hsv(rng.choice([0.0, 0.12, 0.58]), 0.9, 0.85), BLACK)[rng.integers(4)]
        lever = (head, head, nozzle, draw_colour(rng))[rng.integers(4)]
        collar = (head, head, nozzle, shade(head, 0.8))[rng.integers(4)]
        liquid = hsv(rng.random(), rng.choice([0.08, rng.uniform(0.4, 0.9)]), rng.uniform(0.4, 0.75))
        if kind == "clear":
            body = hsv(rng.random(), rng.choice([0.03, 0.15, 0.6]), rng.uniform(0.35, 0.65))
        labels = str(rng.choice(["sides", "around", "shrunk", "none"], p=[0.56, 0.18, 0.14, 0.12]))
        if kind == "clear" and labels == "shrunk":
            labels = "sides"
        wear = rng.uniform(0, 0.7) if rng.random() < 0.4 else 0.0
        last = float(rng.uniform(0.14, 0.36)), labels, wear, float(rng.uniform(0.25, 0.65))
        return cls(kind, body, head, nozzle, lever, collar, liquid, *last, int(rng.integers(2**31)))

    def materials(self, size: tuple[float, float, float], belly: float) -> dict[str, Material]:
        """The material of each part, and of "liquid" and "dip_tube" inside.

        Args:
            size: half extents along x and y, and height of the body [m].
            belly: height of the part that takes labels, as a share of the body's.
        """
        rng = np.random.default_rng(self.seed)
        materials: dict[str, Material] = {name: self._plain(name) for name in _PARTS}
        if self.kind == "scan":
            colour = np.full(3, rng.uniform(0.35, 0.9)) if rng.random() < 0.75 else np.array(self.body) / 255
            one = Material.plain(tuple(colour), roughness=self.gloss)
            materials = {name: one for name in _PARTS}
        if self.kind in ("opaque", "clear"):
            materials["body"] = Material(self._body(size, belly, rng), 0.0, self.gloss)
        clear = 0.3 if max(self.liquid) < 1.15 * min(self.liquid) else 0.5  # water, or something coloured
        materials["liquid"] = Material.plain((*(np.array(self.liquid) / 255), clear), roughness=0.2)
        materials["dip_tube"] = Material.plain((0.93, 0.93, 0.93), roughness=0.5)
        return materials

    def _plain(self, name: str) -> Material:
        colour = {"body": self.body, "nozzle": self.nozzle, "lever": self.lever, "collar": self.collar}
        return Material.plain(tuple(np.array(colour.get(name, self.head)) / 255), roughness=self.gloss)

    def _body(self, size: tuple[float, float, float], belly: float, rng: np.random.Generator) -> np.ndarray:
        half_x, half_y, height = size
        around = 2.8 * (half_x + half_y) + 0.4 * abs(half_x - half_y)
        image = Image.new("RGB", _SIZE, self.body)
        if rng.random() < 0.15:
            image = gradient(*_SIZE, self.body, shade(self.body, rng.choice([0.7, 1.3])))
        opaque = Image.new("L", _SIZE, round(255 * self.opacity) if self.kind == "clear" else 255)
        low = rng.uniform(0.06, 0.12)
        high, half = max(belly * rng.uniform(0.88, 1.0), low + 0.2), rng.uniform(0.1, 0.2)
        regions = {
            "around": [(start, low, start + 0.5, high) for start in (0.0, 0.5)],
            "shrunk": [(start, 0.02, start + 0.5, min(belly * 1.25, 0.9)) for start in (0.0, 0.5)],
            "sides": [(middle - half, low, middle + half, high) for middle in _SIDES],
            "none": [],
        }[self.labels]
        if regions:  # Both sides are printed alike.
            u0, v0, u1, v1 = regions[0]
            printed = label(rng, *patch_size((u1 - u0) * around, (v1 - v0) * height, long_side=224))
        for region in regions:
            paste(image, printed, region)
            paste(opaque, Image.new("L", (8, 8), 255), region)  # The label hides the liquid behind it.
        worn(image, rng, self.wear)
        pixels = grained(image, rng, 2)
        return np.dstack([pixels, np.asarray(opaque)]) if self.kind == "clear" else pixels
