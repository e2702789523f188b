"""Printed matter: words, logos, product labels, stickers and lettering, drawn from a random generator."""

from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grasptransfer.workshop.objects.textures import (
    Colour,
    Ink,
    canvas,
    contrast,
    draw_colour,
    luminance,
    pattern,
    shade,
)

Box = tuple[float, float, float, float]  # left, top, right, bottom [px]

_STARTS = (
    "b",
    "br",
    "c",
    "d",
    "dr",
    "f",
    "g",
    "gl",
    "k",
    "l",
    "m",
    "n",
    "p",
    "pr",
    "r",
    "s",
    "st",
    "t",
    "v",
    "z",
)
_VOWELS = ("a", "e", "i", "o", "u", "a", "e", "o")
_ENDINGS = ("", "", "n", "x", "r", "s", "l", "tec", "max", "on", "ia", "a")
_TAGLINES = (
    *("ORIGINAL", "CLASSIC", "EXTRA FRESH", "NATURAL", "PREMIUM QUALITY", "NEW!", "SINCE 1924", "ULTRA"),
    *(
        "FAMILY SIZE",
        "NO SUGAR",
        "ORGANIC",
        "DAILY CARE",
        "50% MORE",
        "SPARKLING",
        "MADE WITH CARE",
        "STRONG",
    ),
    *(
        "MILD",
        "HEAVY DUTY",
        "PRO SERIES",
        "LEMON",
        "VANILLA",
        "MINT",
        "SEA SALT",
        "500 ml",
        "1 L",
        "250 ml e",
    ),
)
_MOTTOES = (
    *("GOOD\nMORNING", "COFFEE", "TEA TIME", "BEST\nDAD", "BEST\nMUM", "HELLO", "I NEED\nCOFFEE", "HOME"),
    *("RELAX", "MONDAY", "THE BOSS", "KEEP\nSIPPING", "CAPPUCCINO", "No. 1", "LOVE", "TEAM\nBLUE", "COCOA"),
    *(
        "BE KIND",
        "ESPRESSO",
        "DREAM\nBIG",
        "WORK\nHARD",
        "HAPPY\nBIRTHDAY",
        "PARIS",
        "OSLO",
        "LISBOA",
        "SOUP",
    ),
)


def draw_name(rng: np.random.Generator) -> str:
    """A brand name that means nothing."""
    syllables = [str(rng.choice(_STARTS)) + str(rng.choice(_VOWELS)) for _ in range(rng.integers(2, 4))]
    word = "".join(syllables) + str(rng.choice(_ENDINGS))
    return word.upper() if rng.random() < 0.5 else word.capitalize()


def draw_motto(rng: np.random.Generator) -> str:
    """What is printed on mugs, one or two lines."""
    return str(rng.choice(_MOTTOES)) if rng.random() < 0.7 else draw_name(rng)


@lru_cache(maxsize=64)
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def write(image: Image.Image, text: str, box: Box, colour: Ink, *, bold: bool = False) -> None:
    """Write `text` as large as fits the box (left, top, right, bottom) [px], centred.

    Args:
        image: the picture to write into.
        text: one line or several.
        box: left, top, right, bottom [px].
        colour: colour of the letters.
        bold: whether the letters are bold.
    """
    draw = ImageDraw.Draw(image)
    width, height = box[2] - box[0], box[3] - box[1]
    left, top, right, bottom = draw.multiline_textbbox((0, 0), text, font=_font(32), spacing=4)
    size = int(32 * min(width / max(right - left, 1), height / max(bottom - top, 1)))
    if size < 4:
        return
    size = min(size // 2 * 2 if size > 12 else size, 160)  # even sizes only: fewer fonts to keep
    centre = (box[0] + width / 2, box[1] + height / 2)
    stroke = max(size // 22, 1) if bold else 0
    draw.multiline_text(
        centre,
        text,
        fill=colour,
        font=_font(size),
        anchor="mm",
        align="center",
        spacing=size // 8,
        stroke_width=stroke,
    )


def logo(image: Image.Image, rng: np.random.Generator, box: Box, colour: Ink) -> None:
    """A simple mark inside the box (left, top, right, bottom) [px].

    Args:
        image: the picture to draw into.
        rng: decides on the mark.
        box: left, top, right, bottom [px].
        colour: colour of the mark.
    """
    draw = ImageDraw.Draw(image)
    x, y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    radius = min(box[2] - box[0], box[3] - box[1]) / 2
    kind = rng.integers(6)
    around = [x - radius, y - radius, x + radius, y + radius]
    if kind == 0:
        draw.ellipse(around, outline=colour, width=max(int(radius / 6), 1))
        write(
            image,
            draw_name(rng)[:2].upper(),
            (x - radius / 2, y - radius / 2, x + radius / 2, y + radius / 2),
            colour,
        )
    elif kind in (1, 2):
        points = int(rng.integers(3, 9)) if kind == 1 else int(rng.integers(5, 13))
        inner = 1.0 if kind == 1 else rng.uniform(0.35, 0.75)
        draw.polygon(_star(x, y, radius, points, inner), fill=colour)
    elif kind == 3:
        draw.pieslice(around, rng.uniform(0, 360), rng.uniform(360, 640), fill=colour)
    elif kind == 4:
        draw.rounded_rectangle(around, radius / 3, fill=colour)
        write(
            image,
            draw_name(rng)[0],
            (x - radius / 2, y - radius / 2, x + radius / 2, y + radius / 2),
            contrast(colour, rng),
        )
    else:
        for share in (1.0, 0.66, 0.33):
            r = radius * share
            draw.arc([x - r, y - r, x + r, y + r], 180, 360, fill=colour, width=max(int(radius / 6), 1))


def _star(x: float, y: float, radius: float, points: int, inner: float) -> list[tuple[float, float]]:
    angle = np.arange(2 * points) * np.pi / points - np.pi / 2
    size = radius * np.where(
        np.arange(2 * points) % 2, inner * np.cos(np.pi / points) if inner == 1 else inner, 1
    )
    return list(zip(x + size * np.cos(angle), y + size * np.sin(angle), strict=True))


def label(rng: np.random.Generator, width: int, height: int, *, colour: Colour | None = None) -> Image.Image:
    """A product label: brand, tagline, mark, small print, bar code, borders.

    Args:
        width, height: pixels, at the aspect ratio the label has in metres.
        colour: colour of the paper; drawn if None.
    """
    paper = draw_colour(rng) if colour is None else colour
    ink, accent = contrast(paper, rng), draw_colour(rng)
    image = canvas(width, height, paper)
    if rng.random() < 0.3:
        image = pattern(rng, width, height, [paper, shade(paper, rng.choice([0.85, 1.2])), accent])
    draw = ImageDraw.Draw(image)
    _ornament(draw, rng, width, height, accent)
    middle = rng.uniform(0.32, 0.55) * height
    half = rng.uniform(0.12, 0.22) * height
    if rng.random() < 0.5:
        panel = contrast(ink, rng)
        _panel(draw, rng, (0.06 * width, middle - half, 0.94 * width, middle + half), panel)
        ink = ink if abs(luminance(panel) - luminance(ink)) > 60 else contrast(panel, rng)
    inset = (0.1 * width, middle - 0.8 * half, 0.9 * width, middle + 0.8 * half)
    write(image, draw_name(rng), inset, ink, bold=rng.random() < 0.6)
    other = contrast(paper, rng)
    if rng.random() < 0.8:
        top = (0.3 * width, 0.05 * height, 0.7 * width, max(middle - 1.15 * half, 0.08 * height))
        logo(image, rng, top, other)
    below = middle + 1.1 * half
    tagline = (0.15 * width, below, 0.85 * width, below + 0.1 * height)
    write(image, str(rng.choice(_TAGLINES)), tagline, other)
    _small_print(image, rng, (0.12 * width, below + 0.14 * height, 0.88 * width, 0.95 * height), other)
    return image


def _ornament(
    draw: ImageDraw.ImageDraw, rng: np.random.Generator, width: int, height: int, colour: Ink
) -> None:
    kind, band = rng.integers(5), rng.uniform(0.04, 0.2) * height
    if kind == 0:
        draw.rectangle([2, 2, width - 3, height - 3], outline=colour, width=max(height // 40, 1))
    elif kind == 1:
        draw.rectangle([0, 0, width, band], fill=colour)
        draw.rectangle([0, height - band, width, height], fill=colour)
    elif kind == 2:
        draw.polygon(
            [(0, height), (0, height - 3 * band), (width, height - band), (width, height)], fill=colour
        )
    elif kind == 3:
        draw.ellipse([-0.2 * width, 0.55 * height, 1.2 * width, 1.6 * height], fill=colour)


def _panel(draw: ImageDraw.ImageDraw, rng: np.random.Generator, box: Box, colour: Ink) -> None:
    kind = rng.integers(3)
    if kind == 0:
        draw.rectangle(box, fill=colour)
    elif kind == 1:
        draw.ellipse(box, fill=colour)
    else:
        draw.rounded_rectangle(box, (box[3] - box[1]) / 3, fill=colour)


def _small_print(image: Image.Image, rng: np.random.Generator, box: Box, colour: Ink) -> None:
    draw = ImageDraw.Draw(image)
    left, top, right, bottom = box
    if bottom - top < 6:
        return
    if rng.random() < 0.35:
        _barcode(draw, rng, (right - 0.4 * (right - left), top, right, bottom))
        right -= 0.45 * (right - left)
    step = max((bottom - top) / rng.integers(3, 8), 3)
    for y in np.arange(top, bottom - 1, step):
        draw.line(
            [(left, y), (left + rng.uniform(0.5, 1) * (right - left), y)],
            fill=colour,
            width=max(int(step / 4), 1),
        )


def _barcode(draw: ImageDraw.ImageDraw, rng: np.random.Generator, box: Box) -> None:
    draw.rectangle(box, fill=(255, 255, 255))
    x = box[0] + 2
    while x < box[2] - 3:
        thick = int(rng.integers(1, 4))
        draw.rectangle([x, box[1] + 2, x + (thick - 1), box[3] - 2], fill=(0, 0, 0))
        x += thick + int(rng.integers(1, 3))


def lettering(
    rng: np.random.Generator, width: int, height: int, colour: Colour, *, text: str | None = None
) -> Image.Image:
    """A motto or name, perhaps with a mark, on a clear ground (RGBA).

    Args:
        rng: decides on text, mark and layout.
        width, height: size of the picture [px].
        colour: colour of the letters.
        text: what to write; a random motto or name if None.
    """
    image = Image.new("RGBA", (width, height), (*colour, 0))
    opaque = (*colour, 255)
    with_mark = rng.random() < 0.5
    bottom = rng.uniform(0.5, 0.7) * height if with_mark else height
    write(
        image,
        draw_motto(rng) if text is None else text,
        (0, 0, width, bottom - 2),
        opaque,
        bold=rng.random() < 0.5,
    )
    if with_mark:
        logo(image, rng, (0, bottom + 0.03 * height, width, height), opaque)
    return image
