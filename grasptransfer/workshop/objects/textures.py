"""Procedural surface colours: palettes, printed patterns, gradients, speckle, noise and wear.

Pictures are PIL images in sRGB. Draw each picture at the aspect ratio that its region has in metres, then
`paste` it into the part's texture: it is stretched as the UV grid stretches the texture. The functions of
`PATTERNS`, and `glaze`, take the arguments of `pattern`.
"""

import colorsys
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

Colour = tuple[int, int, int]
Ink = tuple[int, ...]  # a colour, perhaps with opacity as a fourth number

WHITE: Colour = (246, 245, 242)
BLACK: Colour = (24, 24, 26)


def hsv(hue: float, saturation: float, value: float) -> Colour:
    """A colour by hue, saturation and value in [0, 1]."""
    red, green, blue = colorsys.hsv_to_rgb(hue % 1, saturation, value)
    return round(255 * red), round(255 * green), round(255 * blue)


def draw_colour(rng: np.random.Generator) -> Colour:
    """A colour as things are made in: white, grey, black, earth, pastel, dark or vivid."""
    kind = rng.choice(["white", "grey", "black", "earth", "pastel", "dark", "vivid"], p=_KINDS)
    hue = rng.random()
    if kind == "white":
        return hsv(rng.uniform(0.05, 0.17), rng.uniform(0, 0.08), rng.uniform(0.88, 1))
    if kind == "grey":
        return hsv(hue, rng.uniform(0, 0.08), rng.uniform(0.3, 0.8))
    if kind == "black":
        return hsv(hue, rng.uniform(0, 0.3), rng.uniform(0.05, 0.18))
    if kind == "earth":
        return hsv(rng.uniform(0.04, 0.14), rng.uniform(0.25, 0.65), rng.uniform(0.3, 0.85))
    if kind == "pastel":
        return hsv(hue, rng.uniform(0.12, 0.4), rng.uniform(0.8, 1))
    if kind == "dark":
        return hsv(hue, rng.uniform(0.5, 1), rng.uniform(0.2, 0.5))
    return hsv(hue, rng.uniform(0.65, 1), rng.uniform(0.6, 1))


_KINDS = [0.2, 0.1, 0.1, 0.1, 0.14, 0.12, 0.24]


def contrast(colour: Ink, rng: np.random.Generator) -> Colour:
    """A colour that shows on `colour`."""
    for _ in range(8):
        other = draw_colour(rng)
        if abs(luminance(other) - luminance(colour)) > 70:
            return other
    return BLACK if luminance(colour) > 128 else WHITE


def luminance(colour: Ink) -> float:
    """Perceived brightness, 0 to 255."""
    return 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]


def shade(colour: Ink, factor: float) -> Colour:
    """The colour made darker (below 1) or lighter (above 1)."""

    def shaded(channel: int) -> int:
        return int(channel * factor) if factor <= 1 else int(255 - (255 - channel) / factor)

    return shaded(colour[0]), shaded(colour[1]), shaded(colour[2])


def canvas(width: int, height: int, colour: Colour) -> Image.Image:
    """A picture of one colour."""
    return Image.new("RGB", (max(int(width), 1), max(int(height), 1)), colour)


def patch_size(width: float, height: float, *, long_side: int = 256) -> tuple[int, int]:
    """Pixels of a picture that covers `width` x `height` (any unit) without distortion."""
    scale = long_side / max(width, height)
    return max(round(width * scale), 8), max(round(height * scale), 8)


def paste(
    texture: Image.Image, patch: Image.Image, region: tuple[float, float, float, float], *, flip: bool = False
) -> None:
    """Put `patch` upright into the UV region (u0, v0, u1, v1) of `texture`; u may pass 0 or 1 and wraps.

    An alpha channel of the patch blends it in. `flip` mirrors it, for surfaces seen from inside.

    Args:
        texture: the picture to paste into, changed in place.
        patch: the picture to paste.
        region: u0, v0, u1, v1 of the texture.
        flip: whether the patch is mirrored.
    """
    width, height = texture.size
    u0, v0, u1, v1 = region
    size = max(round((u1 - u0) * width), 1), max(round((v1 - v0) * height), 1)
    stretched = patch.resize(size, Image.Resampling.BILINEAR, reducing_gap=2.0)
    if flip:
        stretched = stretched.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    mask = stretched if stretched.mode == "RGBA" else None
    for turn in (-1, 0, 1):
        left = round((u0 + turn) * width)
        if left < width and left + size[0] > 0:
            texture.paste(stretched, (left, round((1 - v1) * height)), mask)


def smooth_noise(
    rng: np.random.Generator, width: int, height: int, *, cells: int = 6
) -> Float[np.ndarray, "h w"]:
    """Soft blotches in about [-1, 1]: `cells` of them along the longer side; left meets right.

    Args:
        rng: where the blotches are drawn from.
        width, height: size [px].
        cells: number of blotches along the longer side.
    """
    share = cells / max(width, height)
    coarse = rng.normal(0, 0.5, (max(int(height * share), 2), max(int(width * share), 2))).astype(np.float32)
    columns = coarse.shape[1]
    around = Image.fromarray(np.pad(coarse, ((0, 0), (2, 2)), mode="wrap"))
    box = (2, 0, 2 + columns, coarse.shape[0])
    return np.asarray(around.resize((width, height), Image.Resampling.BICUBIC, box=box))


def grained(image: Image.Image, rng: np.random.Generator, strength: float) -> UInt8[np.ndarray, "h w c"]:
    """The picture with fine grain and soft blotches; `strength` in grey levels."""
    pixels = np.asarray(image).astype(np.float32)
    height, width = pixels.shape[:2]
    grain = rng.normal(0, strength * 0.5, (height, width)) + strength * smooth_noise(rng, width, height)
    pixels[..., :3] += grain[..., None]
    return np.clip(pixels, 0, 255).astype(np.uint8)


def worn(image: Image.Image, rng: np.random.Generator, strength: float) -> None:
    """Scratches and stains; `strength` from 0 (new) to 1 (battered)."""
    draw = ImageDraw.Draw(image, "RGBA")
    width, height = image.size
    for _ in range(rng.poisson(14 * strength)):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        angle, length = rng.uniform(0, np.pi), rng.uniform(4, 0.12 * width)
        end = (x + length * np.cos(angle), y + length * np.sin(angle))
        tone = 255 if rng.random() < 0.6 else 20
        draw.line([(x, y), end], fill=(tone, tone, tone, int(rng.uniform(30, 130))), width=1)
    for _ in range(rng.poisson(5 * strength)):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        radius = rng.uniform(1, 0.03 * width)
        tone = shade(hsv(rng.uniform(0.05, 0.12), 0.5, 0.4), 1)
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=(*tone, int(rng.uniform(15, 60))))


def gradient(width: int, height: int, top: Colour, bottom: Colour) -> Image.Image:
    """A vertical change of colour.

    Args:
        width, height: size [px].
        top, bottom: colours at the two edges.
    """
    column = np.linspace(top, bottom, max(height, 2)).astype(np.uint8)[:, None]
    return Image.fromarray(column).resize((width, height))


def stripes(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Horizontal, vertical or slanted stripes."""
    pixels_y, pixels_x = np.mgrid[:height, :width]
    kind, period = rng.choice(["h", "v", "d"], p=[0.55, 0.25, 0.2]), rng.uniform(0.06, 0.4) * height
    turns = max(round(width / period), 1) * period / width  # a whole number of periods, to close around
    along = {"h": pixels_y, "v": pixels_x * turns, "d": pixels_x * turns + pixels_y}[kind]
    edges = np.cumsum(rng.dirichlet(np.full(len(colours), 3.0)))[:-1]
    return Image.fromarray(np.array(colours, np.uint8)[np.searchsorted(edges, (along / period) % 1)])


def dots(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Dots, rings, diamonds, hearts or flowers, in rows or scattered."""
    image = canvas(width, height, colours[0])
    draw = ImageDraw.Draw(image)
    motif = _MOTIFS[rng.integers(len(_MOTIFS))]
    rows = int(rng.integers(3, 9))
    step = height / rows
    columns = max(round(width / step), 1)
    radius, jitter = step * rng.uniform(0.15, 0.42), step * rng.choice([0, 0, 0.35])
    for row in range(rows):
        for column in range(columns):
            x = (column + 0.5 * (row % 2) + 0.25) * width / columns + rng.uniform(-1, 1) * jitter
            y = (row + 0.5) * step + rng.uniform(-1, 1) * jitter
            motif(draw, x, y, radius, colours[1 + (row + column) % (len(colours) - 1)])
    return image


def checks(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Checks or tartan."""
    rows = int(rng.integers(3, 10))
    columns = 2 * max(round(rows * width / height / 2), 1)
    y, x = np.mgrid[:height, :width]
    row, column = y * rows // height, x * columns // width
    if rng.random() < 0.5:
        return Image.fromarray(np.array(colours[:2], np.uint8)[(row + column) % 2])
    base, band = np.array(colours[0], float), np.array(colours[1], float)
    weight = ((row % 2).astype(float) + (column % 2))[..., None] / 2
    return Image.fromarray((base + weight * (band - base)).astype(np.uint8))


def waves(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Waves or zigzags, closed around."""
    y, x = np.mgrid[:height, :width]
    count, lift, rows = rng.integers(3, 14), rng.uniform(0.02, 0.08), rng.uniform(2, 8)
    phase = x / width * count
    swing = np.sin(2 * np.pi * phase) if rng.random() < 0.5 else 4 * np.abs(phase % 1 - 0.5) - 1
    band = (y / height + lift * swing) * rows
    return Image.fromarray(np.array(colours, np.uint8)[band.astype(int) % len(colours)])


def speckles(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Stoneware speckle or terrazzo chips."""
    image = canvas(width, height, colours[0])
    draw = ImageDraw.Draw(image)
    size = height * rng.uniform(0.005, 0.05)
    for _ in range(int(rng.integers(60, 260))):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        corners = rng.normal((x, y), size, (4, 2))
        draw.polygon([tuple(corner) for corner in corners], fill=colours[int(rng.integers(1, len(colours)))])
    return image


def glaze(rng: np.random.Generator, width: int, height: int, colours: list[Colour]) -> Image.Image:
    """Two glazes that run into each other with an uneven edge, or a marbled one."""
    blotch = smooth_noise(rng, width, height, cells=int(rng.integers(4, 16)))
    if rng.random() < 0.6:
        rise = np.linspace(1, 0, height)[:, None] - rng.uniform(0.25, 0.75)
        mix = np.clip((rise + 0.1 * blotch) * rng.choice([4, 12, 40]) + 0.5, 0, 1)
    else:
        mix = np.clip(0.5 + 0.9 * np.sin(4 * blotch), 0, 1)
    first, second = np.array(colours[0], float), np.array(colours[1], float)
    return Image.fromarray((first + mix[..., None] * (second - first)).astype(np.uint8))


PATTERNS: tuple[Callable, ...] = (stripes, dots, checks, waves, speckles)


def pattern(
    rng: np.random.Generator, width: int, height: int, colours: list[Colour] | None = None
) -> Image.Image:
    """One of `PATTERNS` in two to four colours.

    Args:
        rng: decides on the pattern.
        width, height: size [px].
        colours: the ground first; drawn if None.
    """
    if colours is None:
        first = draw_colour(rng)
        colours = [first, contrast(first, rng), draw_colour(rng), draw_colour(rng)][: int(rng.integers(2, 5))]
    return PATTERNS[rng.integers(len(PATTERNS))](rng, width, height, colours)


def _dot(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour) -> None:
    draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)


def _ring(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour) -> None:
    draw.ellipse(
        [x - radius, y - radius, x + radius, y + radius], outline=colour, width=max(int(radius / 3), 1)
    )


def _diamond(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour) -> None:
    draw.polygon([(x - radius, y), (x, y - radius), (x + radius, y), (x, y + radius)], fill=colour)


def _flower(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour) -> None:
    for angle in np.arange(5) * 2 * np.pi / 5:
        _dot(draw, x + 0.6 * radius * np.cos(angle), y + 0.6 * radius * np.sin(angle), 0.42 * radius, colour)
    _dot(draw, x, y, 0.35 * radius, shade(colour, 0.5))


def _heart(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour) -> None:
    for side in (-1, 1):
        _dot(draw, x + side * 0.48 * radius, y - 0.3 * radius, 0.52 * radius, colour)
    draw.polygon(
        [(x - 0.95 * radius, y - 0.1 * radius), (x + 0.95 * radius, y - 0.1 * radius), (x, y + radius)],
        colour,
    )


_MOTIFS = (_dot, _ring, _diamond, _flower, _heart)
