"""Colours, prints and materials of cameras: leatherette, silver tops, coloured shells, type on the lens."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from grasptransfer.workshop.objects.labels import draw_name, write
from grasptransfer.workshop.objects.shape import Material
from grasptransfer.workshop.objects.textures import (
    BLACK,
    WHITE,
    Colour,
    canvas,
    contrast,
    draw_colour,
    grained,
    hsv,
    luminance,
    paste,
    shade,
    worn,
)

_DARK = ("glass", "flash", "window", "screen", "eyepiece", "shoe")
_PARTS = ("body", "grip", "hump", "lens", "button", "mode_dial", "second_dial", *_DARK)
_LENS_TYPES = (
    "18-55 mm 1:3.5-5.6",
    "50 mm 1:1.8",
    "24-70 mm",
    "f=4.3-21.5 mm 1:2.8",
    "35 mm F2",
    "OPTICAL ZOOM 10x",
)
_MODES = ("M", "A", "S", "P", "AUTO", "C1", "SCN", "B")


@dataclass(frozen=True)
class CameraFinish:
    """How a camera is coloured.

    Args:
        kind: "printed" has textures; "flat" one colour a part; "scan" is one colour all over.
        shell: colour of the body, or of its leatherette. top: of its top plate, the hump and the dials.
        lens: colour of the barrel. ring: of the ring near its front. ink: of the name.
        leather: height of the leatherette's upper edge, as a share of the body's; 0 without.
        metal: whether top and ring are bare metal. silver_ring: whether a ring of the lens is bright.
        brand, lens_type: what is printed on.
        wear: 0 new to 1 battered. gloss: roughness of the shell. seed: of grain and scratches.
    """

    kind: str
    shell: Colour
    top: Colour
    lens: Colour
    ring: Colour
    ink: Colour
    leather: float
    metal: bool
    silver_ring: bool
    brand: str
    lens_type: str
    wear: float
    gloss: float
    seed: int

    @classmethod
    def typical(cls) -> "CameraFinish":
        """Black leatherette under a silver top."""
        colours = ((34, 34, 36), (186, 187, 190), (30, 30, 32), (190, 190, 192), BLACK)
        return cls("printed", *colours, 0.74, False, True, "DOMIRA", _LENS_TYPES[0], 0.0, 0.5, 5)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "CameraFinish":
        """A random finish."""
        dark = hsv(rng.random(), rng.uniform(0, 0.12), rng.uniform(0.09, 0.2))
        silver = hsv(rng.random(), rng.uniform(0, 0.05), rng.uniform(0.62, 0.85))
        look = rng.choice(["black", "retro", "coloured", "silver"], p=[0.4, 0.22, 0.26, 0.12])
        leather, metal = 0.0, False
        if look == "black":
            shell = top = dark
            leather = float(rng.choice([0.0, 0.7]))
        elif look == "retro":
            brown = hsv(rng.uniform(0.02, 0.09), rng.uniform(0.45, 0.75), rng.uniform(0.3, 0.6))
            shell = brown if rng.random() < 0.3 else (draw_colour(rng) if rng.random() < 0.2 else dark)
            top, leather, metal = silver, float(rng.uniform(0.62, 0.8)), bool(rng.random() < 0.3)
        elif look == "coloured":
            shell = draw_colour(rng)
            top = shell if rng.random() < 0.6 else (dark if rng.random() < 0.5 else silver)
        else:
            shell = top = silver
        lens = (dark, dark, silver, shell)[rng.integers(4)]
        ring = (silver, hsv(0.0, 0.85, 0.7), hsv(0.12, 0.6, 0.75), shell)[rng.integers(4)]
        kind = str(rng.choice(["printed", "flat", "scan"], p=[0.7, 0.12, 0.18]))
        names = draw_name(rng), str(rng.choice(_LENS_TYPES))
        wear = float(rng.uniform(0, 0.6)) if rng.random() < 0.4 else 0.0
        flags = leather, metal, bool(rng.random() < 0.5)
        last = wear, float(rng.uniform(0.3, 0.75)), int(rng.integers(2**31))
        return cls(kind, shell, top, lens, ring, contrast(top, rng), *flags, *names, *last)

    def materials(self, *, humped: bool) -> dict[str, Material]:
        """The material of each part.

        Args:
            humped: the name goes onto the hump, not onto the body.
        """
        rng = np.random.default_rng(self.seed)
        if self.kind == "scan":
            colour = (
                np.full(3, rng.uniform(0.25, 0.85)) if rng.random() < 0.75 else np.array(self.shell) / 255
            )
            return dict.fromkeys(_PARTS, Material.plain(tuple(colour), roughness=self.gloss))
        materials = {name: self._plain(name) for name in _PARTS}
        if self.kind == "printed":
            materials["body"] = Material(_body(self, humped, rng), 0.0, self.gloss)
            materials["grip"] = Material(_grip(self, rng), 0.0, 0.8)
            materials["hump"] = Material(_hump(self), 0.0, self.gloss)
            materials["lens"] = Material(_lens(self, rng), 0.0, 0.45)
            materials["mode_dial"] = materials["second_dial"] = Material(_dial(self), 0.0, 0.5)
        return materials

    def _plain(self, name: str) -> Material:
        colour = {
            "body": self.shell,
            "grip": self.shell if self.leather else shade(self.shell, 0.85),
            "lens": self.lens,
            "glass": (18, 20, 34),
            "flash": (226, 228, 232),
            "window": (40, 44, 58),
            "screen": (16, 17, 20),
            "eyepiece": BLACK,
            "shoe": (70, 71, 74),
            "button": (200, 200, 203) if luminance(self.top) < 120 else shade(self.top, 0.85),
        }.get(name, self.top)
        shiny = {"glass": 0.06, "window": 0.1, "screen": 0.15, "flash": 0.2, "button": 0.3}
        metallic = 0.7 if self.metal and name in ("hump", "mode_dial", "second_dial", "button") else 0.0
        roughness = shiny.get(name, self.gloss)
        return Material.plain(tuple(np.array(colour) / 255), metallic=metallic, roughness=roughness)


def _body(finish: CameraFinish, humped: bool, rng: np.random.Generator) -> np.ndarray:
    width, height = 640, 192
    image = canvas(width, height, finish.shell)
    if finish.leather:
        image = Image.fromarray(grained(image, rng, 12))
    border = finish.leather or (1.0 if finish.top == finish.shell else rng.uniform(0.7, 0.85))
    image.paste(finish.top, (0, 0, width, round(height * (1 - border))))
    if finish.leather:
        image.paste(finish.top, (0, round(height * 0.94), width, height))
    plate = Image.new("RGBA", (160, 36), (0, 0, 0, 0))
    write(plate, finish.brand, (2, 2, 158, 34), (*finish.ink, 255), bold=True)
    if not humped:
        middle, low = rng.uniform(0.365, 0.4), 0.76 if finish.leather else rng.uniform(0.72, 0.8)
        paste(image, plate, (middle - 0.06, low + 0.02, middle + 0.06, low + 0.14))
    small = Image.new("RGBA", (80, 24), (0, 0, 0, 0))
    ink = contrast(finish.shell, rng)
    write(small, f"{finish.brand[0].upper()}{rng.integers(10, 990)}", (2, 2, 78, 22), (*ink, 255))
    if rng.random() < 0.6:
        paste(image, small, (0.62, 0.1, 0.68, 0.18) if rng.random() < 0.5 else (0.63, 0.6, 0.68, 0.67))
    _back(image, finish)
    worn(image, rng, finish.wear)
    return grained(image, rng, 2)


def _back(image: Image.Image, finish: CameraFinish) -> None:
    """Round keys beside the screen: the back lies about u = 0."""
    key = Image.new("RGBA", (32, 32), (0, 0, 0, 0))
    key.paste((*shade(finish.shell, 0.5), 255), (4, 4, 28, 28))
    for low in (0.2, 0.4, 0.6):
        paste(image, key, (0.12, low, 0.145, low + 0.08))


def _grip(finish: CameraFinish, rng: np.random.Generator) -> np.ndarray:
    ground = finish.shell if finish.leather or rng.random() < 0.5 else shade(finish.shell, 0.7)
    return grained(canvas(96, 96, ground), rng, 14 if luminance(finish.shell) < 60 or finish.leather else 3)


def _hump(finish: CameraFinish) -> np.ndarray:
    # u = 0 is the middle of the front: the name wraps over the seam.
    image = canvas(384, 96, finish.top)
    plate = canvas(128, 32, finish.top)
    write(plate, finish.brand, (4, 2, 124, 30), finish.ink, bold=True)
    paste(image, plate, (-0.11, 0.56, 0.11, 0.78))
    return np.asarray(image)


def _lens(finish: CameraFinish, rng: np.random.Generator) -> np.ndarray:
    width, height = 384, 160
    image = canvas(width, height, finish.lens)

    def band(low: float, high: float, colour: Colour) -> None:
        image.paste(colour, (0, round(height * (1 - high)), width, round(height * (1 - low))))

    if finish.silver_ring:
        band(0.0, 0.12, finish.ring)
    for low, high in ((0.3, 0.51), (0.6, 0.75)):
        band(low, high, shade(finish.lens, 0.6))
        for left in range(0, width, 8):
            image.paste(
                shade(finish.lens, 1.5),
                (left, round(height * (1 - high)), left + 3, round(height * (1 - low))),
            )
    band(0.765, 0.79, finish.ring)
    band(0.82, 1.0, BLACK)
    ink = WHITE if luminance(finish.lens) < 120 else BLACK
    numbers = canvas(192, 20, finish.lens)
    for index, text in enumerate(rng.choice(["18", "24", "35", "50", "70", "105", "1.2", "3", "oo"], 5)):
        write(numbers, str(text), (38 * index, 2, 38 * index + 34, 18), ink)
    turned = numbers.transpose(Image.Transpose.FLIP_LEFT_RIGHT).transpose(Image.Transpose.FLIP_TOP_BOTTOM)
    paste(image, turned, (0.3, 0.52, 0.7, 0.59))
    rim = canvas(320, 24, BLACK)
    write(rim, f"{finish.brand.upper()}  {finish.lens_type}", (0, 2, 320, 22), WHITE)
    turned = rim.transpose(Image.Transpose.FLIP_LEFT_RIGHT).transpose(Image.Transpose.FLIP_TOP_BOTTOM)
    paste(image, turned, (0.1, 0.865, 0.9, 0.925))
    return np.asarray(image)


def _dial(finish: CameraFinish) -> np.ndarray:
    image = canvas(256, 64, finish.top)
    ink = WHITE if luminance(finish.top) < 120 else BLACK
    for left in range(0, 256, 8):
        image.paste(shade(finish.top, 0.6), (left, 16, left + 3, 40))
    for index, text in enumerate(_MODES):
        write(image, text, (32 * index + 4, 0, 32 * index + 28, 9), ink)
    return np.asarray(image)
