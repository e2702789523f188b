"""Batches for training: backgrounds, occluders and the faults of real cameras, added on the fly."""

import io

import numpy as np
import torch
from jaxtyping import Float32, Int64, UInt8
from PIL import Image, ImageFilter
from torch import Tensor

from grasptransfer.perception.network_input import network_input
from grasptransfer.perception.zoom import ZOOM_HEIGHT, ZOOM_WIDTH, mask_cells
from grasptransfer.workshop.training.dataset import Dataset

STRANGERS = 0.12  # share of samples that show an object of another category
Inputs = tuple[Float32[Tensor, "b 8 192 256"], Int64[Tensor, "b"]]  # pictures, number of the category


def training_batch(
    dataset: Dataset, indices: np.ndarray, rng: np.random.Generator
) -> tuple[Inputs, dict[str, Tensor]]:
    """Augmented input and targets of the samples at `indices`."""
    arrays = dataset.batch(indices)
    match = rng.random(len(indices)) >= STRANGERS
    for index in np.flatnonzero(~match):
        name = dataset.categories[arrays["category"][index]]
        arrays["observed"][index], arrays["box"][index] = _stranger(
            arrays["box"][index], arrays["canonical"][index], dataset, name, rng
        )
    pictures, masks = zip(*(_compose(observed, dataset, rng) for observed in arrays["observed"]), strict=True)
    targets = {
        "offset": torch.from_numpy(arrays["offset"]).permute(0, 3, 1, 2).float(),
        "flow": torch.from_numpy(arrays["flow"]).permute(0, 3, 1, 2).float(),
        "valid": torch.from_numpy(arrays["valid"] & match[:, None, None])[:, None].float(),
        "mask": torch.from_numpy(np.stack(masks))[:, None],
        "latent": torch.from_numpy(arrays["latent"]),
        "mode_size": torch.from_numpy(arrays["mode_size"]),
        "match": torch.from_numpy(match).float(),
    }
    pictures = network_input(np.stack(pictures), arrays["box"], arrays["canonical"])
    return (torch.from_numpy(pictures), torch.from_numpy(arrays["category"]).long()), targets


def _stranger(
    box: Float32[np.ndarray, "4"],
    canonical: UInt8[np.ndarray, "192 256 3"],
    dataset: Dataset,
    category: str,
    rng: np.random.Generator,
) -> tuple[UInt8[np.ndarray, "192 256 5"], Float32[np.ndarray, "4"]]:
    """An object of another category at the place of the object, and its box if a box was given."""
    rows, columns = np.nonzero(canonical.any(-1))
    place = box if np.isfinite(box).all() else [columns.min(), rows.min(), columns.max(), rows.max()]
    u0, v0, u1, v1 = (float(value) for value in place)
    others = np.flatnonzero(dataset.sprite_names != category)
    sprite = Image.fromarray(dataset.sprites[rng.choice(others)], "RGBA")
    sprite = sprite.crop(sprite.getchannel("A").getbbox() or (0, 0, *sprite.size))
    scale = max(u1 - u0, v1 - v0, 8.0) / max(sprite.size)
    width, height = sprite.size
    size = max(round(width * scale), 4), max(round(height * scale), 4)
    sprite = sprite.resize(size)
    left, top = round((u0 + u1 - size[0]) / 2), round((v0 + v1 - size[1]) / 2)
    whole = Image.new("RGBA", (ZOOM_WIDTH, ZOOM_HEIGHT))
    whole.paste(sprite, (left, top))
    pixels = np.asarray(whole)
    observed = np.dstack([pixels, 255 * (pixels[..., 3] > 127).astype(np.uint8)])
    around = np.array([left, top, left + size[0], top + size[1]], np.float32)
    return observed, np.where(np.isfinite(box), around, box)


def _compose(
    observed: UInt8[np.ndarray, "192 256 5"], dataset: Dataset, rng: np.random.Generator
) -> tuple[UInt8[np.ndarray, "192 256 3"], Float32[np.ndarray, "48 64"]]:
    """The picture and the share of each mask cell that the visible object covers."""
    alpha = observed[..., 3:4].astype(np.float32) / 255
    picture = observed[..., :3].astype(np.float32) * rng.uniform(0.6, 1.3) + _background(dataset, rng) * (
        1 - alpha
    )
    mask = observed[..., 4].astype(np.float32) / 255
    for _ in range(rng.integers(1, 3) if rng.random() < 0.25 else 0):
        _occlude(picture, mask, dataset, rng)
    picture = _degrade(_photometry(picture, rng), rng)
    return picture, mask_cells(mask)


def _background(dataset: Dataset, rng: np.random.Generator) -> Float32[np.ndarray, "192 256 3"]:
    whole = dataset.backgrounds[rng.integers(len(dataset.backgrounds))]
    top, left = rng.integers(whole.shape[0] - ZOOM_HEIGHT + 1), rng.integers(whole.shape[1] - ZOOM_WIDTH + 1)
    cut = whole[top : top + ZOOM_HEIGHT, left : left + ZOOM_WIDTH]
    if rng.random() < 0.5:
        cut = cut[:, ::-1]
    return cut.astype(np.float32) * rng.uniform(0.6, 1.3)


def _occlude(picture: Float32[np.ndarray, "h w 3"], mask: Float32[np.ndarray, "h w"], dataset, rng):
    """Paste an object in front, in place."""
    side = int(rng.uniform(40, 150))
    sprite = Image.fromarray(dataset.sprites[rng.integers(len(dataset.sprites))], "RGBA").resize((side, side))
    sprite = np.asarray(sprite.rotate(rng.uniform(-40, 40))).astype(np.float32)
    u, v = (
        int(rng.uniform(-side / 2, ZOOM_WIDTH - side / 2)),
        int(rng.uniform(-side / 2, ZOOM_HEIGHT - side / 2)),
    )
    rows, columns = slice(max(v, 0), min(v + side, ZOOM_HEIGHT)), slice(max(u, 0), min(u + side, ZOOM_WIDTH))
    cut = sprite[rows.start - v : rows.stop - v, columns.start - u : columns.stop - u]
    cover = cut[..., 3:] / 255
    hidden = mask[rows, columns] * (cover[..., 0] > 0.5)
    if hidden.sum() > 0.4 * mask.sum():  # An object that is mostly hidden teaches nothing.
        return
    picture[rows, columns] = picture[rows, columns] * (1 - cover) + cut[..., :3] * cover
    mask[rows, columns] -= hidden


def _photometry(picture: Float32[np.ndarray, "h w 3"], rng: np.random.Generator) -> Image.Image:
    """Saturation, white balance, contrast, exposure (all linear), then gamma."""
    saturation, contrast = rng.uniform(0.3, 1.3), rng.uniform(0.6, 1.3)
    mix = saturation * np.eye(3) + (1 - saturation) / 3
    mix *= contrast * (1 + rng.normal(0, 0.08, 3))
    shift = 128 * (1 - contrast) + rng.uniform(-30, 30)
    picture = picture @ mix.astype(np.float32) + np.float32(shift)
    gamma = 255 * (np.arange(256) / 255) ** rng.uniform(0.7, 1.4)
    return Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8)).point(
        np.tile(gamma, 3).round().tolist()
    )


def _degrade(image: Image.Image, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Low resolution, blur, sensor noise and JPEG."""
    if rng.random() < 0.5:
        share = rng.uniform(0.25, 0.9)
        small = image.resize((int(ZOOM_WIDTH * share), int(ZOOM_HEIGHT * share)), Image.Resampling.BILINEAR)
        image = small.resize((ZOOM_WIDTH, ZOOM_HEIGHT), Image.Resampling.BILINEAR)
    if rng.random() < 0.25:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.4, 1.8)))
    if rng.random() < 0.5:
        noise = rng.standard_normal((ZOOM_HEIGHT, ZOOM_WIDTH, 3), np.float32) * rng.uniform(1, 12)
        image = Image.fromarray(np.clip(np.asarray(image) + noise, 0, 255).astype(np.uint8))
    if rng.random() < 0.3:
        memory = io.BytesIO()
        image.save(memory, "JPEG", quality=int(rng.uniform(30, 92)))
        image = Image.open(memory)
    return np.asarray(image)
