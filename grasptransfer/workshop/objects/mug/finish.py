"""What mugs are made of and printed with: glaze, prints, enamel, steel, glass, or plain grey."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from grasptransfer.workshop.objects import labels, textures
from grasptransfer.workshop.objects.mug.parameters import MugParameters
from grasptransfer.workshop.objects.shape import Material
from grasptransfer.workshop.objects.textures import Colour

_SIZE = (512, 384)
# Upper ends of the body's texture bands: underside, outside, rim, inside wall; the floor ends at 1.
V_UNDER, V_OUTSIDE, V_RIM, V_INSIDE = 0.06, 0.70, 0.75, 0.94
_DRINKS: tuple[Colour, ...] = ((46, 26, 14), (160, 112, 66), (150, 74, 20), (236, 228, 214), (190, 60, 30))


@dataclass(frozen=True)
class MugMaterials:
    """Materials of a mug's parts."""

    body: Material
    handle: Material
    drink: Material


def canonical_materials() -> MugMaterials:
    """White glaze."""
    white = Material.plain((0.93, 0.92, 0.90), roughness=0.35)
    return MugMaterials(white, white, Material.plain((0.2, 0.1, 0.06)))


def draw_materials(p: MugParameters, rng: np.random.Generator) -> MugMaterials:
    """Random materials that suit these parameters."""
    drink = _drink(p, rng)
    style = str(rng.choice(list(_STYLES), p=[share for share, _ in _STYLES.values()]))
    body, handle = _STYLES[style][1](p, rng)
    return MugMaterials(body, handle, drink)


def _drink(p: MugParameters, rng: np.random.Generator) -> Material:
    colour = np.array(_DRINKS[rng.integers(len(_DRINKS))]) / 255
    # An empty mug keeps the part, for the topology, and hides it.
    return Material.plain((*colour, 1.0 if p.fill > 0.1 else 0.0), roughness=0.3)


def _grey(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    """As untextured scans and CAD models come."""
    colour = np.full(3, rng.uniform(0.35, 0.9)) + rng.normal(0, 0.01, 3)
    material = Material.plain(colour, roughness=rng.uniform(0.5, 1))
    return material, material


def _plain(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    colour = _glaze_colour(rng)
    return _glazed(_new_canvas(colour), colour, rng)


def _two_tone(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    outside, inside = _glaze_colour(rng), textures.draw_colour(rng)
    image = _new_canvas(outside)
    _fill(image, (V_RIM, 1.0), inside)
    if rng.random() < 0.5:
        _fill(image, (V_OUTSIDE, V_RIM), inside)
    if rng.random() < 0.3:  # The lower part is bare clay or another glaze.
        _fill(image, (0.0, rng.uniform(0.12, 0.4)), textures.draw_colour(rng))
    if rng.random() < 0.2:  # halves: the handle's side differs
        half = textures.canvas(64, 64, textures.draw_colour(rng))
        textures.paste(image, half, (-0.25, 0, 0.25, V_RIM))
    return _glazed(image, inside if rng.random() < 0.6 else outside, rng)


def _patterned(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    colour = _glaze_colour(rng)
    image = _new_canvas(colour)
    others = [textures.contrast(colour, rng), *(textures.draw_colour(rng) for _ in range(rng.integers(0, 3)))]
    if rng.random() < 0.25:
        textures.paste(image, textures.glaze(rng, 512, 256, [colour, *others]), (0, 0.0, 1, 0.72))
    else:
        low, high = (V_UNDER, V_OUTSIDE) if rng.random() < 0.6 else sorted(rng.uniform(0.1, 0.68, 2))
        high = max(high, low + 0.1)
        width, height = _patch(p, 1.0, high - low)
        textures.paste(image, textures.pattern(rng, width, height, [colour, *others]), (0, low, 1, high))
    return _glazed(image, colour if rng.random() < 0.7 else others[0], rng)


def _printed(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    colour = _glaze_colour(rng)
    image = _new_canvas(colour)
    share = rng.uniform(0.16, 0.36)
    low = rng.uniform(0.12, 0.25)
    high = rng.uniform(0.5, 0.65)
    width, height = _patch(p, share, high - low)
    ink = textures.contrast(colour, rng)
    for middle in (0.25, 0.75) if rng.random() < 0.5 else (float(rng.choice([0.25, 0.5, 0.75])),):
        if rng.random() < 0.7:
            print_ = labels.lettering(rng, width, height, ink)
        else:
            print_ = labels.label(rng, width, height)
        textures.paste(image, print_, (middle - share / 2, low, middle + share / 2, high))
    if rng.random() < 0.3:
        _fill(image, (V_RIM, 1.0), ink)
    return _glazed(image, colour if rng.random() < 0.8 else ink, rng)


def _enamel(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    colour = _glaze_colour(rng)
    image = _new_canvas(colour)
    dark = textures.shade(textures.draw_colour(rng), 0.3)
    _fill(image, (0.68, 0.77), dark)
    if rng.random() < 0.5:
        _fill(image, (0.77, 1.0), textures.WHITE)
    textures.worn(image, rng, rng.uniform(0, 1))
    return _glazed(image, dark if rng.random() < 0.4 else colour, rng)


def _steel(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    tone = int(rng.uniform(150, 215))
    image = _new_canvas((tone, tone, min(tone + 3, 255)))
    streaks = np.asarray(image).astype(float) + rng.normal(0, 5, (_SIZE[1], 1, 1))
    image = Image.fromarray(np.clip(streaks, 0, 255).astype(np.uint8))
    if rng.random() < 0.4:
        _fill(image, (0.1, 0.62), textures.draw_colour(rng))
    metallic, roughness = rng.uniform(0.3, 0.8), rng.uniform(0.25, 0.5)
    body = Material(np.asarray(image), metallic, roughness)
    black = rng.random() < 0.3
    handle = Material.plain(
        np.full(3, 0.1 if black else tone / 255), metallic=0 if black else metallic, roughness=roughness
    )
    return body, handle


def _glass(p: MugParameters, rng: np.random.Generator) -> tuple[Material, Material]:
    tint = np.array([0.80, 0.88, 0.88]) if rng.random() < 0.7 else np.array(textures.draw_colour(rng)) / 255
    opacity = rng.uniform(0.22, 0.4)
    rgba = np.empty((_SIZE[1], _SIZE[0], 4), np.uint8)
    rgba[..., :3] = np.clip(255 * tint, 0, 255)
    rgba[..., 3] = int(255 * opacity)
    rim = slice(int((1 - V_RIM) * _SIZE[1]), int((1 - 0.69) * _SIZE[1]))
    rgba[rim, :, 3] = int(255 * min(opacity * 1.8, 1))  # The line of sight passes more glass at rim and foot.
    rgba[int(0.93 * _SIZE[1]) :, :, 3] = int(255 * min(opacity * 1.6, 1))
    handle = Material.plain((*tint, min(opacity * 1.5, 0.8)), roughness=0.1)
    return Material(rgba, 0.0, 0.1), handle


# Share of all mugs, and how they are made. Plain grey is frequent because most scans and CAD models are.
_STYLES = {
    "grey": (0.14, _grey),
    "plain": (0.25, _plain),
    "two_tone": (0.15, _two_tone),
    "patterned": (0.15, _patterned),
    "printed": (0.18, _printed),
    "enamel": (0.05, _enamel),
    "steel": (0.04, _steel),
    "glass": (0.04, _glass),
}


def _glaze_colour(rng: np.random.Generator) -> Colour:
    if rng.random() < 0.35:
        return textures.hsv(rng.uniform(0.05, 0.17), rng.uniform(0, 0.08), rng.uniform(0.86, 1))
    return textures.draw_colour(rng)


def _new_canvas(colour: Colour) -> Image.Image:
    return textures.canvas(*_SIZE, colour)


def _fill(image: Image.Image, band: tuple[float, float], colour: Colour) -> None:
    textures.paste(image, textures.canvas(8, 8, colour), (0, band[0], 1, band[1]))


def _patch(p: MugParameters, share: float, band: float) -> tuple[int, int]:
    """Pixels of a print that takes `share` of the circumference and `band` of v."""
    height = p.height * band / (V_OUTSIDE - V_UNDER)
    return textures.patch_size(2 * np.pi * p.radius * share, height, long_side=320)


def _glazed(image: Image.Image, handle: Colour, rng: np.random.Generator) -> tuple[Material, Material]:
    roughness = rng.uniform(0.15, 0.5) if rng.random() < 0.7 else rng.uniform(0.6, 0.95)
    pixels = textures.grained(image, rng, rng.uniform(0, 5))
    return Material(pixels, 0.0, roughness), Material.plain(np.array(handle) / 255, roughness=roughness)
