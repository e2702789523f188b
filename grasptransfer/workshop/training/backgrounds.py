"""Backgrounds without photographs: rooms, tables, textures and clutter of our own objects."""

import numpy as np
from jaxtyping import Float, Float32, UInt8
from PIL import Image, ImageDraw, ImageFilter

BACKGROUND_WIDTH, BACKGROUND_HEIGHT = 320, 240  # px
Sprite = UInt8[np.ndarray, "hs ws 4"]


def draw_backdrop(rng: np.random.Generator, width: int, height: int) -> UInt8[np.ndarray, "h w 3"]:
    """A random background without clutter, as large as a camera's picture [px]."""
    return np.asarray(Image.fromarray(draw_background(rng, [])).resize((width, height)))


def draw_background(rng: np.random.Generator, sprites: list[Sprite]) -> UInt8[np.ndarray, "240 320 3"]:
    """A random background.

    Args:
        sprites: RGBA pictures of objects to strew as clutter; may be empty.
    """
    kind = rng.random()
    if kind < 0.12:
        picture = np.broadcast_to(_colour(rng), (BACKGROUND_HEIGHT, BACKGROUND_WIDTH, 3)) + _noise(rng, 4)
    elif kind < 0.35:
        picture = _surface(rng, BACKGROUND_HEIGHT, BACKGROUND_WIDTH)
    else:
        picture = _room(rng)
    image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    if rng.random() < 0.6:
        _strew_polygons(image, rng)
    for _ in range(rng.integers(0, 7) if sprites and rng.random() < 0.75 else 0):
        _paste(image, sprites[rng.integers(len(sprites))], rng)
    if rng.random() < 0.5:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 3.0)))
    return np.asarray(image)


def _colour(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    """Mostly the greys, browns and whites of rooms, sometimes any colour."""
    if rng.random() < 0.7:
        return np.clip(rng.uniform(15, 245) * (1 + rng.normal(0, 0.08, 3) + [0.04, 0, -0.06]), 0, 255)
    return rng.uniform(0, 255, 3)


def _noise(rng: np.random.Generator, strength: float) -> Float[np.ndarray, "240 320 1"]:
    return _smooth_noise(rng, BACKGROUND_HEIGHT, BACKGROUND_WIDTH)[..., None] * strength * 4


def _smooth_noise(
    rng: np.random.Generator, height: int, width: int, stretch: float = 1.0
) -> Float32[np.ndarray, "h w"]:
    """Noise at several scales, each an enlarged random picture; about -1 to 1."""
    total = np.zeros((height, width), np.float32)
    slope = rng.uniform(0.5, 1.3)  # how much stronger the coarse scales are
    for octave in range(1, 7):
        rows, columns = 2**octave, max(2, int(2**octave * width / height / stretch))
        coarse = Image.fromarray(rng.normal(size=(rows, columns)).astype(np.float32))
        total += np.asarray(coarse.resize((width, height), Image.Resampling.BICUBIC)) / 2 ** (slope * octave)
    return total / max(np.abs(total).max(), 1e-6)


def _surface(rng: np.random.Generator, height: int, width: int) -> Float[np.ndarray, "h w 3"]:
    """Cloth, wood, stone, tiles or stripes seen from above."""
    first, second = _colour(rng), _colour(rng)
    if rng.random() < 0.6:
        second = first * rng.uniform(0.6, 1.3)
    kind = rng.choice(["noise", "wood", "tiles", "stripes", "fine"])
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    angle, period = rng.uniform(0, np.pi), rng.uniform(6, 70)
    along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    if kind == "wood":
        rings = across / period + 1.5 * _smooth_noise(rng, height, width, stretch=rng.uniform(3, 8))
        share = 0.5 + 0.5 * np.sin(2 * np.pi * rings)
    elif kind == "tiles":
        joint = rng.uniform(0.02, 0.15)
        share = ((along / period % 1 < joint) | (across / period % 1 < joint)).astype(np.float32)
        if rng.random() < 0.4:
            share = ((along // period + across // period) % 2).astype(np.float32)
    elif kind == "stripes":
        share = (along / period % 1 < rng.uniform(0.2, 0.8)).astype(np.float32)
    elif kind == "fine":
        share = np.clip(0.5 + rng.normal(0, 0.25, (height, width)), 0, 1)
    else:
        share = 0.5 + 0.5 * _smooth_noise(rng, height, width)
    picture = first + (second - first) * share[..., None]
    return picture * (1 + rng.uniform(0, 0.4) * _smooth_noise(rng, height, width)[..., None])


def _room(rng: np.random.Generator) -> Float[np.ndarray, "240 320 3"]:
    """A wall and a table top in perspective, with light falling off to one side."""
    height, width = BACKGROUND_HEIGHT, BACKGROUND_WIDTH
    picture = (
        _surface(rng, height, width) if rng.random() < 0.3 else _colour(rng) + _noise(rng, rng.uniform(0, 10))
    )
    picture = np.array(np.broadcast_to(picture, (height, width, 3)))
    horizon = int(rng.uniform(-0.3, 0.7) * height)
    texture = _surface(rng, 256, 256)
    v, u = np.mgrid[max(horizon, 0) : height, 0:width]
    depth = 1 / (v - horizon + rng.uniform(2, 12))
    scale = rng.uniform(1500, 9000)
    rows = (depth * scale).astype(int)
    columns = np.floor((u - rng.uniform(0, width)) * depth * scale / 60).astype(int)
    picture[max(horizon, 0) :] = texture[rows % 256, columns % 256]
    slope = rng.normal(0, 0.3, 2)
    v, u = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return picture * (1 + slope[0] * u + slope[1] * v)[..., None]


def _strew_polygons(image: Image.Image, rng: np.random.Generator):
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(1, 9)):
        centre = rng.uniform([0, 0], [BACKGROUND_WIDTH, BACKGROUND_HEIGHT])
        size = np.exp(rng.uniform(np.log(6), np.log(110), 2))
        colour = tuple(int(value) for value in _colour(rng))
        if rng.random() < 0.35:
            draw.ellipse([*(centre - size / 2), *(centre + size / 2)], fill=colour)
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
            points = centre + np.stack([np.cos(angles), np.sin(angles)], -1) * size / 2
            draw.polygon([tuple(point) for point in points], fill=colour)


def _paste(image: Image.Image, sprite: Sprite, rng: np.random.Generator):
    side = int(np.exp(rng.uniform(np.log(30), np.log(180))))
    scaled = Image.fromarray(sprite, "RGBA").resize((side, max(8, side * sprite.shape[0] // sprite.shape[1])))
    if rng.random() < 0.5:
        scaled = scaled.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    corner = (
        int(rng.uniform(-side / 2, BACKGROUND_WIDTH - side / 2)),
        int(rng.uniform(-side / 2, BACKGROUND_HEIGHT)),
    )
    image.paste(scaled, corner, scaled)
