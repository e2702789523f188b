"""Rendered training samples on disk: shards written once, in parallel, resumable, and read by memory map."""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt8

from grasptransfer.category import Category
from grasptransfer.category.category import PREVIEW
from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing, write_whole
from grasptransfer.jobs import run
from grasptransfer.workshop.training.backgrounds import draw_background
from grasptransfer.workshop.training.samples import Sample

SHARD = 128  # samples a file
VIEWS_PER_SHAPE = 4  # drawing a shape costs more than a view of it
SPRITE_SIDE = 160  # px
OF_NO_CATEGORY = "random object"


@dataclass(frozen=True)
class DatasetConfig:
    """What a data set holds; two data sets of equal config are equal but for the renderer's rounding.

    Args:
        categories: cycled shape by shape.
        samples: how many, rounded up to whole shards.
        seed: seed of everything random.
        backgrounds: pictures in the background bank.
        sprites: cut-out objects that serve as clutter, occluders and objects of another category.
        held_out: show test instances, where a category has no generator; see `training_shapes.instances_of`.
    """

    categories: tuple[Category, ...]
    samples: int = 20_000
    seed: int = 0
    backgrounds: int = 2000
    sprites: int = 600
    held_out: bool = False

    @property
    def shards(self) -> int:
        """Number of shard files."""
        return -(-self.samples // SHARD)

    def as_data(self) -> dict:
        """The settings as plain names and numbers."""
        data = {field.name: getattr(self, field.name) for field in fields(self)}
        return data | state_of(self.categories)

    def digest(self) -> str:
        """Short checksum of the settings."""
        return hashlib.sha256(json.dumps(self.as_data(), sort_keys=True).encode()).hexdigest()[:12]


def state_of(categories: Sequence[Category]) -> dict:
    """Names of the categories, and checksums of the files that training reads."""
    checksums = {
        category.name: {name: one for name, one in category.file.checksums.items() if name != PREVIEW}
        for category in categories
    }
    return {"categories": [category.name for category in categories], "checksums": checksums}


def build_dataset(
    config: DatasetConfig,
    folder: Path,
    *,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render the missing shards of a data set and return its folder.

    Args:
        folder: parent; the data set lies in `folder/<digest>` and is completed where it was left.
        progress: called with (shards done, shards in all).
    """
    target = folder / config.digest()
    target.mkdir(parents=True, exist_ok=True)
    _clear_up(target)
    write_whole(target / "config.json", json.dumps(config.as_data(), indent=1).encode())
    pieces: list[tuple] = []
    if not (target / "sprites.npy").exists():
        _write_sprites(config, target)
    if not (target / "backgrounds.npy").exists():
        pieces.append((_write_backgrounds,))
    pieces += [
        (_write_shard, index) for index in range(config.shards) if not _shard_path(target, index).exists()
    ]
    done = config.shards + 1 - len(pieces)
    for ended in run(_write, pieces, workers=workers, shared=(config, target)):
        ended.result()
        done += 1
        if progress:
            progress(done, config.shards + 1)
    return target


def _clear_up(target: Path):
    """Remove what a killed run left unfinished: all that is hidden."""
    for leftover in target.glob(".*"):
        if leftover.is_dir():
            shutil.rmtree(leftover)
        else:
            leftover.unlink()


class Dataset:
    """Reads a built data set; `arrays[name]` is one memory-mapped array per shard."""

    def __init__(self, folder: Path):
        self.paths = sorted(folder.glob("*.shard"))
        if not self.paths:
            raise SettingsError("holds no training samples", path=folder, fix="Build it first")
        self.backgrounds: UInt8[np.ndarray, "n 240 320 3"] = np.load(
            folder / "backgrounds.npy", mmap_mode="r"
        )
        self.sprites: UInt8[np.ndarray, "n s s 4"] = np.load(folder / "sprites.npy")
        self.sprite_names = np.array(sprite_names(len(self.sprites)))
        self.categories: list[str] = json.loads((folder / "config.json").read_text())["categories"]
        self._shards = [
            {field.name: np.load(path / f"{field.name}.npy", mmap_mode="r") for field in fields(Sample)}
            for path in self.paths
        ]
        lengths = [len(shard["box"]) for shard in self._shards]
        self._starts = np.concatenate([[0], np.cumsum(lengths)])

    def __len__(self) -> int:
        return int(self._starts[-1])

    def batch(self, indices: Int[np.ndarray, "b"]) -> dict[str, np.ndarray]:
        """The samples at `indices`, stacked field by field."""
        shards = np.searchsorted(self._starts, indices, side="right") - 1
        return {
            field.name: np.stack(
                [
                    self._shards[s][field.name][i - self._starts[s]]
                    for s, i in zip(shards, indices, strict=True)
                ]
            )
            for field in fields(Sample)
        }


def _shard_path(target: Path, index: int) -> Path:
    return target / f"{index:05d}.shard"


def _write(config: DatasetConfig, target: Path, part: Callable, *which: int):
    part(config, target, *which)


def _write_shard(config: DatasetConfig, target: Path, index: int):
    from grasptransfer.drawing.rendering import Renderer
    from grasptransfer.workshop.training.samples import render_sample
    from grasptransfer.workshop.training.training_shapes import (
        draw_training_shape,
        instances_of,
        training_canonical,
    )

    rng = np.random.default_rng([config.seed, 1, index])
    canonicals = [training_canonical(category) for category in config.categories]
    instances = [instances_of(category, held_out=config.held_out) for category in config.categories]
    samples: list[Sample] = []
    turn = index
    with Renderer() as renderer:
        while len(samples) < SHARD:
            which = turn % len(canonicals)
            turn += 1
            shape = draw_training_shape(canonicals[which], instances[which], rng)
            views = (
                render_sample(shape, canonicals[which], rng, renderer=renderer, category=which)
                for _ in range(VIEWS_PER_SHAPE)
            )
            samples += [view for view in views if view is not None]
    with tempfile.TemporaryDirectory(prefix=".", dir=target) as hidden:
        shard = Path(hidden) / "shard"  # unlike the folder around it, others may read it
        shard.mkdir()
        for field in fields(Sample):
            np.save(shard / f"{field.name}.npy", np.stack([getattr(s, field.name) for s in samples[:SHARD]]))
        os.replace(shard, _shard_path(target, index))


def sprite_names(count: int) -> list[str]:
    """What each sprite shows: a generator's category, or an object of none."""
    from grasptransfer.workshop import objects

    names = [*objects.generators(), OF_NO_CATEGORY]
    return [names[index % len(names)] for index in range(count)]


def _write_sprites(config: DatasetConfig, target: Path):
    from grasptransfer.camera import Camera
    from grasptransfer.drawing.rendering import Renderer
    from grasptransfer.drawing.views import look_at
    from grasptransfer.workshop import objects
    from grasptransfer.workshop.training.random_objects import draw_random_object
    from grasptransfer.workshop.training.scenes import draw_lighting

    rng = np.random.default_rng([config.seed, 2])
    camera = Camera.from_fov(SPRITE_SIDE, SPRITE_SIDE, np.deg2rad(30))
    sprites = []
    with Renderer() as renderer:
        for name in sprite_names(config.sprites):
            if name == OF_NO_CATEGORY:
                scene = draw_random_object(rng)
            else:
                scene = objects.sample(name, int(rng.integers(2**31))).scene()
            pose = look_at(1.9 * scene.scale, rng.uniform(0, 7), rng.uniform(0, 1.2))
            picture = renderer.render(scene, camera, pose, lighting=draw_lighting(rng))
            alpha = np.round(np.maximum(picture.alpha, 0.6 * picture.mask) * 255).astype(np.uint8)
            sprites.append(np.dstack([picture.rgb, alpha]))
    _save(target / "sprites.npy", np.stack(sprites))


def _write_backgrounds(config: DatasetConfig, target: Path):
    rng = np.random.default_rng([config.seed, 3])
    sprites = list(np.load(target / "sprites.npy"))
    _save(
        target / "backgrounds.npy",
        np.stack([draw_background(rng, sprites) for _ in range(config.backgrounds)]),
    )


def _save(path: Path, array: np.ndarray):
    with replacing(path) as unfinished:
        np.save(unfinished, array)
