"""A training set of four samples of mugs, and a network so narrow that it trains in a moment."""

import contextlib
import dataclasses
import json
from pathlib import Path

import pytest

from grasptransfer.category import Category, load_category
from grasptransfer.workshop.training import dataset
from grasptransfer.workshop.training.dataset import DatasetConfig

MUG = load_category("mug")
CONFIG = DatasetConfig((MUG,), samples=4, seed=3, backgrounds=2, sprites=2)
WIDTH = 0.1
# Settings of a training on it, for `TrainingConfig`.
SMALL = {"width": WIDTH, "samples": 4, "held_out": 4, "members": 1, "steps": 1, "batch": 2}


@contextlib.contextmanager
def small_shards():
    """All four samples lie in one shard."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "SHARD", 4)
        yield


def build_small(parent: Path) -> Path:
    """The folder of the training set, below `parent`."""
    # In this process: the shortened shard length would not reach a spawned one.
    target = parent / CONFIG.digest()
    target.mkdir()
    (target / "config.json").write_text(json.dumps(CONFIG.as_data()))
    with small_shards():
        dataset._write_sprites(CONFIG, target)
        dataset._write_backgrounds(CONFIG, target)
        dataset._write_shard(CONFIG, target, 0)
    return target


def rebuilt(file: str = "shape_space.npz") -> Category:
    """The mugs as they would be after a build that changed this file."""
    checksums = MUG.file.checksums | {file: "another"}
    return dataclasses.replace(MUG, file=MUG.file.model_copy(update={"checksums": checksums}))
