"""Materials of drills: two-tone shells with rubber grips, vents, screws, type on housing and battery."""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image, ImageDraw

from grasptransfer.workshop.objects.drill.finish import DrillFinish
from grasptransfer.workshop.objects.labels import write
from grasptransfer.workshop.objects.shape import Material
from grasptransfer.workshop.objects.textures import (
    Colour,
    contrast,
    grained,
    luminance,
    paste,
    patch_size,
    shade,
    worn,
)

_PARTS = (
    *("housing", "clutch", "chuck", "bit", "speed_switch", "side_handle"),
    *("handle", "trigger", "selector", "foot", "battery", "cord"),
)


def materials(finish: DrillFinish, battery_aspect: float) -> dict[str, Material]:
    """The material of each part.

    Args:
        battery_aspect: height of the battery's sides as a share of their length.
    """
    rng = np.random.default_rng(finish.seed)
    if finish.kind == "scan":
        colour = np.full(3, rng.uniform(0.3, 0.85)) if rng.random() < 0.75 else np.array(finish.shell) / 255
        return dict.fromkeys(_PARTS, Material.plain(tuple(colour), roughness=finish.gloss))
    plain = {name: _plain(finish, name) for name in _PARTS}
    if finish.kind == "flat":
        return plain
    painted = {
        "housing": _housing(finish, rng),
        "handle": _handle(finish, rng),
        "foot": _foot(finish, rng),
        "battery": _battery(finish, battery_aspect, rng),
        "clutch": _clutch(finish, rng),
        "chuck": _chuck(finish),
    }
    for name, image in painted.items():
        base = plain[name]
        plain[name] = Material(np.asarray(image), base.metallic, base.roughness)
    return plain


def _plain(finish: DrillFinish, name: str) -> Material:
    colour = {
        "chuck": finish.chuck,
        "bit": (190, 190, 195),
        "trigger": finish.trigger,
        "battery": finish.battery,
        "housing": finish.shell,
        "foot": finish.shell,
        "handle": finish.shell if finish.kind == "printed" else finish.rubber,
    }.get(name, finish.rubber)
    metallic = 0.85 if name == "bit" or (name == "chuck" and finish.metal_chuck) else 0.0
    roughness = {"bit": 0.3, "chuck": 0.35 if finish.metal_chuck else 0.55, "trigger": 0.5}
    return Material.plain(
        tuple(np.array(colour) / 255), metallic=metallic, roughness=roughness.get(name, finish.gloss)
    )


@lru_cache(maxsize=8)
def _uv(width: int, height: int) -> tuple[Float[np.ndarray, "1 w"], Float[np.ndarray, "h 1"]]:
    """u of each column and v of each row."""
    return (np.arange(width)[None] + 0.5) / width, 1 - (np.arange(height)[:, None] + 0.5) / height


def _blank(width: int, height: int, colour: Colour) -> Image.Image:
    return Image.new("RGB", (width, height), colour)


def _fill(image: Image.Image, where: Bool[np.ndarray, "h w"], colour: Colour) -> None:
    image.paste(colour, mask=Image.fromarray(where))


def _both_sides(
    image: Image.Image, patch: Image.Image, u: tuple[float, float], v: tuple[float, float]
) -> None:
    """Print on both sides of a part that lies along x, readable on each; `u` as on the +y side."""
    paste(image, patch.transpose(Image.Transpose.ROTATE_270), (u[0], v[0], u[1], v[1]))
    paste(image, patch.transpose(Image.Transpose.ROTATE_90), (1 - u[1], v[0], 1 - u[0], v[1]))


def _housing(finish: DrillFinish, rng: np.random.Generator) -> Image.Image:
    image = _blank(384, 256, finish.shell)
    u, v = _uv(384, 256)
    wave = np.cos(2 * np.pi * (u - 0.5))
    slant, belly = rng.uniform(-0.1, 0.1), rng.uniform(0.0, 0.13)
    if rng.random() < 0.3:  # a shell of two colours, one above the other
        _fill(image, np.abs(u - 0.5) < rng.uniform(0.1, 0.2) + 0.05 * np.sin(3 * v), finish.rubber)
    _fill(image, v > 1 - finish.nose + slant * wave, finish.rubber)
    _fill(image, v < finish.bumper + 0.3 * slant * wave, finish.rubber)
    _fill(image, np.abs((u + 0.5) % 1 - 0.5) < belly * (1.2 - np.abs(2 * v - 0.9)), finish.rubber)
    _fill(image, (np.abs(u - 0.5) < 0.004) & (v > 0.03) & (v < 0.97), shade(finish.shell, 0.6))
    _vents(image, finish, rng)
    plate = Image.new("RGBA", (192, 64), (0, 0, 0, 0))
    ink = finish.accent
    if rng.random() < 0.45:
        ground = finish.rubber if rng.random() < 0.7 else shade(finish.shell, 0.7)
        ImageDraw.Draw(plate).rounded_rectangle([0, 4, 191, 59], 14, fill=(*ground, 255))
        ink = (
            finish.accent if abs(luminance(ground) - luminance(finish.accent)) > 60 else contrast(ground, rng)
        )
    write(plate, finish.brand, (16, 10, 176, 54), (*ink, 255), bold=rng.random() < 0.7)
    middle = rng.uniform(0.22, 0.3)
    low = max(finish.bumper, 0.2) + 0.06
    _both_sides(
        image, plate, (middle - 0.055, middle + 0.055), (low, min(low + rng.uniform(0.3, 0.42), 0.92))
    )
    _screws(image, rng, ((0.14, 0.32), (0.17, 0.62), (0.33, 0.15), (0.2, 0.88)))
    worn(image, rng, finish.wear)
    return Image.fromarray(grained(image, rng, 4))


def _vents(image: Image.Image, finish: DrillFinish, rng: np.random.Generator) -> None:
    draw, (width, height) = ImageDraw.Draw(image), image.size
    lean, length = rng.uniform(-0.04, 0.04), rng.uniform(0.06, 0.14)
    upright, dark = rng.random() < 0.6, shade(finish.shell, 0.25)
    for slit in range(finish.vents):
        for side in (-1, 1):
            if upright:  # slits around the housing, one behind the other
                v = 0.07 + 0.022 * slit
                ends = [(0.5 + side * (0.25 - length), v + lean), (0.5 + side * (0.25 + length / 2), v)]
            else:
                u = 0.5 + side * (0.19 + 0.022 * slit)
                ends = [(u, 0.06), (u + lean, 0.06 + length)]
            draw.line([(a * width, (1 - b) * height) for a, b in ends], fill=dark, width=3)


def _screws(image: Image.Image, rng: np.random.Generator, places: tuple[tuple[float, float], ...]) -> None:
    draw, (width, height) = ImageDraw.Draw(image), image.size
    for u, v in places:
        if rng.random() < 0.7:
            x, y = u * width, (1 - v) * height  # seen on the +y side only, as on most tools
            draw.ellipse([x - 4, y - 3, x + 4, y + 3], fill=(30, 30, 32), outline=(90, 90, 92))


def _handle(finish: DrillFinish, rng: np.random.Generator) -> Image.Image:
    image = _blank(256, 192, finish.shell)
    u, v = _uv(256, 192)
    low, high = rng.uniform(0.0, 0.2), rng.uniform(0.7, 1.0)
    edge = finish.grip * (1 + 0.35 * np.sin(2 * np.pi * (v * rng.uniform(0.6, 1.2) + rng.random())))
    rubber = (np.abs(u - 0.5) < edge) & (v > low) & (v < high)
    _fill(image, rubber, finish.rubber)
    if rng.random() < 0.35:  # grip in front, too
        _fill(image, (np.abs((u + 0.5) % 1 - 0.5) < 0.12) & (v > 0.1) & (v < 0.6), finish.rubber)
    if rng.random() < 0.5:
        ribs = rubber & ((v * rng.integers(18, 40)) % 1 < 0.35) & (np.abs(u - 0.5) < 0.7 * edge)
        _fill(image, ribs, shade(finish.rubber, 0.6))
    _screws(image, rng, ((0.2, 0.12), (0.22, 0.78)))
    worn(image, rng, finish.wear)
    return Image.fromarray(grained(image, rng, 3))


def _foot(finish: DrillFinish, rng: np.random.Generator) -> Image.Image:
    image = _blank(256, 128, finish.shell)
    u, v = _uv(256, 128)
    if rng.random() < 0.4:
        _fill(image, v + 0 * u < rng.uniform(0.08, 0.4), finish.rubber)
    if rng.random() < 0.5:
        plate = Image.new("RGBA", (160, 32), (0, 0, 0, 0))
        write(plate, finish.brand, (4, 2, 156, 30), (*finish.accent, 255), bold=True)
        for middle in (0.25, 0.75):
            paste(image, plate, (middle - 0.09, 0.08, middle + 0.09, 0.36))
    _screws(image, rng, ((0.3, 0.4), (0.18, 0.3)))
    worn(image, rng, finish.wear)
    return Image.fromarray(grained(image, rng, 3))


def _battery(finish: DrillFinish, aspect: float, rng: np.random.Generator) -> Image.Image:
    image = _blank(512, 128, finish.battery)
    u, v = _uv(512, 128)
    if rng.random() < 0.5:
        _fill(image, np.abs(v - rng.uniform(0.55, 0.85)) + 0 * u < rng.uniform(0.03, 0.1), finish.rubber)
    if aspect > 0.2:
        _battery_label(image, finish, aspect, rng)
    if rng.random() < 0.5:  # button of the catch
        _fill(
            image, (np.abs((u + 0.5) % 1 - 0.5) < 0.05) & (np.abs(v - 0.7) < 0.08), shade(finish.accent, 0.8)
        )
    worn(image, rng, finish.wear)
    return Image.fromarray(grained(image, rng, 3))


def _battery_label(image: Image.Image, finish: DrillFinish, aspect: float, rng: np.random.Generator) -> None:
    ground = finish.shell if rng.random() < 0.4 else finish.battery
    ink = finish.accent if abs(luminance(ground) - luminance(finish.accent)) > 60 else contrast(ground, rng)
    width, height = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.5)  # shares of the side
    plate = Image.new("RGB", patch_size(width, height * aspect, long_side=160), ground)
    margin = 0.12 * plate.height
    text = finish.type_name if rng.random() < 0.7 else finish.brand
    write(
        plate,
        text,
        (margin, margin, plate.width - margin, plate.height - margin),
        ink,
        bold=rng.random() < 0.6,
    )
    # A side of the foot takes about 0.3 of the way around.
    shift, low = rng.uniform(-0.04, 0.04), rng.uniform(0.25, 0.85 - height)
    for middle in (0.25 + shift, 0.75 - shift):
        paste(image, plate, (middle - 0.15 * width, low, middle + 0.15 * width, low + height))


def _clutch(finish: DrillFinish, rng: np.random.Generator) -> Image.Image:
    band = finish.shell if rng.random() < 0.3 else finish.rubber
    image = _blank(256, 48, band)
    ink = contrast(band, rng)
    turns = int(rng.integers(10, 20))
    if rng.random() < 0.7:
        for number in range(turns):
            left = 256 * number / turns
            write(image, str(number + 1), (left + 2, 12, left + 256 / turns - 2, 28), ink)
    return image


def _chuck(finish: DrillFinish) -> Image.Image:
    image = _blank(128, 128, finish.chuck)
    u, v = _uv(128, 128)
    _fill(image, (v > 0.93) & (u < 2), shade(finish.chuck, 0.25))  # the hole
    _fill(image, ((u * 24) % 1 < 0.4) & (v > 0.4) & (v < 0.62), shade(finish.chuck, 0.55))
    _fill(image, ((u * 24) % 1 < 0.4) & (v > 0.08) & (v < 0.28), shade(finish.chuck, 0.65))
    _fill(image, (np.abs(v - 0.33) < 0.02) & (u < 2), shade(finish.chuck, 0.4))
    return image
