"""What bottles are made of: PET and glass with liquid behind, opaque plastic, labels, caps, plain grey."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from grasptransfer.workshop.objects import labels, textures
from grasptransfer.workshop.objects.bottle.parameters import BottleParameters
from grasptransfer.workshop.objects.shape import Material
from grasptransfer.workshop.objects.textures import Colour

_SIZE = (448, 448)
V_UNDER, V_TOP = 0.04, 0.96  # texture band of the outside, linear in height
_COLA, _RED_WINE = (44, 18, 10), (70, 8, 24)
_SODAS: tuple[Colour, ...] = (_COLA, _COLA, (240, 130, 20), (250, 215, 60), (120, 190, 60), (200, 40, 60))
_DARK_GLASS: tuple[Colour, ...] = ((30, 56, 24), (20, 32, 16), (52, 66, 20), (70, 38, 12), (12, 14, 12))
_BEER_GLASS: tuple[Colour, ...] = ((84, 42, 10), (66, 32, 8), (30, 80, 36), (110, 60, 16))
_SAUCES: tuple[Colour, ...] = ((176, 20, 16), (150, 14, 20), (236, 190, 30), (250, 244, 224), (60, 22, 14))


@dataclass(frozen=True)
class BottleMaterials:
    """Materials of a bottle's parts."""

    body: Material
    cap: Material
    liquid: Material


def canonical_materials() -> BottleMaterials:
    """White plastic with a blue cap."""
    water = Material.plain((0.8, 0.9, 0.95, 0.3), roughness=0.1)
    return BottleMaterials(Material.plain((0.92, 0.92, 0.92)), Material.plain((0.1, 0.25, 0.6)), water)


@dataclass(frozen=True)
class _Stuff:
    """A bottle's wall and what is behind it: colours, the wall's opacity, and the liquid's."""

    wall: Colour
    opacity: float
    liquid: Colour
    liquid_opacity: float
    roughness: float


def draw_materials(p: BottleParameters, rng: np.random.Generator) -> BottleMaterials:
    """Random materials that suit this kind of bottle."""
    if rng.random() < 0.13:
        return _grey(rng)
    stuff = _draw_stuff(p.kind, rng)
    image = textures.canvas(*_SIZE, stuff.wall)
    cover = Image.new("L", _SIZE, round(255 * stuff.opacity))
    if stuff.opacity == 1 and rng.random() < 0.2:
        other = textures.draw_colour(rng)
        textures.paste(image, textures.gradient(8, 256, other, stuff.wall), (0, 0, 1, 1))
    _thick_glass(image, cover, stuff, rng)
    accent = _labels(p, image, cover, rng)
    if stuff.opacity == 1:
        textures.worn(image, rng, rng.uniform(0, 0.7))
    pixels = textures.grained(image, rng, rng.uniform(0, 3))
    if stuff.opacity < 1:
        pixels = np.concatenate([pixels, np.asarray(cover)[..., None]], axis=2)
    liquid = Material.plain((*(np.array(stuff.liquid) / 255), stuff.liquid_opacity), roughness=0.25)
    cap = _cap(p, stuff, accent, rng)
    return BottleMaterials(Material(pixels, 0.0, stuff.roughness), cap, liquid)


def _grey(rng: np.random.Generator) -> BottleMaterials:
    """As untextured scans and CAD models come."""
    grey = Material.plain(np.full(3, rng.uniform(0.35, 0.9)), roughness=rng.uniform(0.5, 1))
    cap = grey if rng.random() < 0.7 else Material.plain(np.full(3, rng.uniform(0.3, 0.9)), roughness=0.8)
    return BottleMaterials(grey, cap, grey)


def _pick(rng: np.random.Generator, colours: tuple[Colour, ...]) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _draw_stuff(kind: str, rng: np.random.Generator) -> _Stuff:
    clear, water = (176, 196, 202), (178, 212, 228)
    pet = (rng.uniform(0.14, 0.26), rng.uniform(0.08, 0.2))
    if kind == "water" or (kind in ("sport", "baby") and rng.random() < 0.5):
        tint = (
            clear if rng.random() < 0.5 else textures.hsv(rng.uniform(0.45, 0.62), rng.uniform(0.1, 0.6), 0.9)
        )
        return _Stuff(tint, pet[0], water, 0.28, pet[1])
    if kind == "soda":
        return _Stuff(clear, pet[0], _pick(rng, _SODAS), 0.94, pet[1])
    if kind == "wine" and rng.random() < 0.8:
        return _Stuff(_pick(rng, _DARK_GLASS), rng.uniform(0.72, 0.96), _RED_WINE, 1.0, 0.12)
    if kind in ("wine", "spirit"):
        drink = _pick(rng, ((226, 200, 110), (170, 90, 20), water, (236, 130, 110)))
        return _Stuff((160, 186, 172), rng.uniform(0.18, 0.32), drink, 0.7, 0.08)
    if kind == "beer":
        if rng.random() < 0.25:
            return _Stuff(clear, rng.uniform(0.22, 0.35), (216, 150, 40), 0.85, 0.1)
        return _Stuff(_pick(rng, _BEER_GLASS), rng.uniform(0.65, 0.9), (90, 40, 8), 1.0, 0.1)
    if kind == "pill" and rng.random() < 0.6:
        amber = _pick(rng, ((214, 110, 20), (190, 84, 10), (120, 54, 10)))
        return _Stuff(amber, rng.uniform(0.55, 0.8), (240, 236, 226), 1.0, 0.15)
    if kind in ("sauce", "mustard"):
        if rng.random() < 0.25:
            return _Stuff(clear, pet[0], _pick(rng, _SAUCES), 1.0, 0.2)
        return _Stuff(_pick(rng, _SAUCES), 1.0, water, 1.0, rng.uniform(0.25, 0.6))
    if kind in ("detergent", "shampoo", "lotion") and rng.random() < 0.3:
        soap = textures.hsv(rng.random(), rng.uniform(0.3, 0.8), rng.uniform(0.7, 1))
        return _Stuff((226, 230, 232), rng.uniform(0.25, 0.5), soap, 0.85, 0.25)
    return _Stuff(textures.draw_colour(rng), 1.0, water, 1.0, rng.uniform(0.25, 0.8))


def _thick_glass(image: Image.Image, cover: Image.Image, stuff: _Stuff, rng: np.random.Generator) -> None:
    """Thicker glass in the line of sight at foot and neck, and the long soft highlights of clear bottles."""
    if stuff.opacity == 1:
        return
    more = min(stuff.opacity * 1.8, 0.97)
    for low, high in ((0.0, 0.06), (0.90, 1.0)):
        textures.paste(cover, Image.new("L", (4, 4), round(255 * more)), (0, low, 1, high))
    white = Image.new("RGB", (4, 4), (255, 255, 255))
    for _ in range(rng.integers(1, 4)):
        u, width = rng.random(), rng.uniform(0.008, 0.025)
        low, high = rng.uniform(0.06, 0.2), rng.uniform(0.6, 0.9)
        streak = (u, low, u + width, high)
        textures.paste(cover, Image.new("L", (4, 4), round(255 * min(more + 0.2, 1))), streak)
        textures.paste(image, white, streak)


def _labels(p: BottleParameters, image: Image.Image, cover: Image.Image, rng: np.random.Generator) -> Colour:
    """Stick labels on; returns a colour that the cap may share with them."""
    around = np.pi * p.half_width * (1 + p.depth)
    body = p.shoulder * 0.97  # share of the height that is straight enough to take a label
    low, high = sorted((rng.uniform(0.06, 0.3) * body, rng.uniform(0.6, 1.0) * body))
    kind = str(
        rng.choice(["front", "wrap", "both", "sleeve", "print", "none"], p=[0.34, 0.24, 0.16, 0.06, 0.1, 0.1])
    )
    paper = textures.draw_colour(rng)
    v0, v1 = _v(low), _v(high)
    size = (high - low) * p.height
    share = float(np.clip(rng.uniform(0.26, 0.46), 0.2, 0.9 * p.height / around))
    if kind == "sleeve":
        v0, v1, size = 0.0, _v(p.neck - 0.02), p.neck * p.height
    if kind in ("wrap", "sleeve"):
        patch = labels.label(rng, *_pixels(around / 3, size), colour=paper)
        for turn in (-1, 0, 1):
            u = 0.5 + turn / 3
            _stick(image, cover, patch, (u - 1 / 6, v0, u + 1 / 6, v1))
    elif kind in ("front", "both"):
        patch = labels.label(rng, *_pixels(share * around, size), colour=paper)
        if rng.random() < 0.25:
            patch.putalpha(_rounded(patch.size, oval=rng.random() < 0.5))
        _stick(image, cover, patch, (0.5 - share / 2, v0, 0.5 + share / 2, v1))
        if kind == "both":
            back = labels.label(rng, *_pixels(share * around, size), colour=paper)
            _stick(image, cover, back, (-share / 2, v0, share / 2, v1))
    elif kind == "print":
        red, green, blue = np.asarray(image)[_SIZE[1] // 2, _SIZE[0] // 2].tolist()
        ink = textures.contrast((red, green, blue), rng)
        letters = labels.lettering(rng, *_pixels(share * around, size), ink, text=labels.draw_name(rng))
        _stick(image, cover, letters, (0.5 - share / 2, v0, 0.5 + share / 2, v1))
    if p.kind in ("wine", "beer") and rng.random() < 0.7:
        if rng.random() >= 0.5:
            paper = textures.shade(textures.draw_colour(rng), 0.6)
        start = rng.uniform(p.neck, 0.5 + 0.5 * p.neck)
        end = 1.0 if p.kind == "wine" else start + 0.1
        _stick(image, cover, textures.canvas(8, 8, paper), (0, _v(start), 1, end))
    return paper


def _v(share: float) -> float:
    """Texture coordinate of the outside at this share of the height."""
    return V_UNDER + (V_TOP - V_UNDER) * share


def _pixels(width: float, height: float) -> tuple[int, int]:
    return textures.patch_size(width, height, long_side=280)


def _rounded(size: tuple[int, int], *, oval: bool) -> Image.Image:
    from PIL import ImageDraw

    mask = Image.new("L", size, 0)
    box = (0, 0, size[0] - 1, size[1] - 1)
    draw = ImageDraw.Draw(mask)
    if oval:
        draw.ellipse(box, fill=255)
    else:
        draw.rounded_rectangle(box, min(size) / 5, fill=255)
    return mask


def _stick(
    image: Image.Image, cover: Image.Image, patch: Image.Image, region: tuple[float, float, float, float]
) -> None:
    """Paste a patch, and make the wall opaque where it sticks."""
    textures.paste(image, patch, region)
    if patch.mode == "RGBA":
        opaque = Image.merge("RGBA", [Image.new("L", patch.size, 255)] * 3 + [patch.getchannel("A")])
        stencil = Image.merge("RGBA", [cover, cover, cover, Image.new("L", cover.size, 255)])
        textures.paste(stencil, opaque, region)
        cover.paste(stencil.getchannel("R"))
    else:
        textures.paste(cover, Image.new("L", (4, 4), 255), region)


def _cap(p: BottleParameters, stuff: _Stuff, accent: Colour, rng: np.random.Generator) -> Material:
    if p.open:
        return Material.plain(np.array(stuff.wall) / 255 * 0.5, roughness=0.8)
    if p.kind == "beer":
        colour = textures.draw_colour(rng)
        return _knurled(colour, rng, count=21, metallic=0.5)
    if p.kind == "wine" and rng.random() < 0.4:
        cork = textures.speckles(rng, 128, 128, [(196, 150, 100), (150, 104, 62), (214, 172, 124)])
        return Material(np.asarray(cork), 0.0, 0.9)
    colour = accent if rng.random() < 0.5 else textures.draw_colour(rng)
    if p.kind == "pill" and rng.random() < 0.7:
        colour = textures.WHITE
    if rng.random() < 0.1:
        return Material.plain(np.array((200, 196, 190)) / 255, metallic=0.7, roughness=0.35)
    if rng.random() < 0.6:
        return _knurled(colour, rng, count=int(rng.integers(30, 64)))
    return Material.plain(np.array(colour) / 255, roughness=rng.uniform(0.25, 0.7))


def _knurled(colour: Colour, rng: np.random.Generator, *, count: int, metallic: float = 0.0) -> Material:
    """Upright grooves on the cap's side."""
    image = textures.canvas(256, 64, colour)
    wave = 0.5 + 0.5 * np.cos(np.arange(256) / 256 * 2 * np.pi * count)
    pixels = np.asarray(image).astype(float)
    side = slice(int((1 - 0.58) * 64), int((1 - 0.07) * 64))
    pixels[side] *= (1 - 0.3 * wave)[None, :, None]
    return Material(np.clip(pixels, 0, 255).astype(np.uint8), metallic, float(rng.uniform(0.3, 0.7)))
