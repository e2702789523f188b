"""What a training depends on, and where it runs; light, so that the command line can ask for both."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg
from tyro.constructors import PrimitiveConstructorSpec

from grasptransfer.category import Category, list_categories, load_category
from grasptransfer.errors import SettingsError
from grasptransfer.options import Device, Precision, Workers, check_counts
from grasptransfer.perception.device import choose_device
from grasptransfer.perception.precision import check_precision

# The command takes names and folders.
Categories = Annotated[
    tuple[Category, ...],
    PrimitiveConstructorSpec(
        nargs="*",
        metavar="[CATEGORY …]",
        instance_from_str=lambda given: tuple(load_category(one) for one in given),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [str(one) for one in value],
    ),
]


@dataclass(frozen=True)
class TrainingConfig:
    """All that the weights depend on. The defaults made the shipped weights.

    Args:
        categories: trained together in one network; none given: all shipped ones.
        network: see `grasptransfer.perception.networks`.
        width: factor on the number of channels of the network's layers.
        members: networks trained alike but for the seed; their mean is the answer.
        loss: likelihood, or paper (squared offsets times 1000).
        samples: rendered training samples.
        held_out: rendered samples of shapes that training does not see, to watch.
        steps: optimiser steps of each member.
        batch: samples a step, over all processes.
        echo: how often each augmented batch is used; 2 halves what preparing them costs.
        learning_rate: peak; it falls over the last 30 % of the steps.
        weight_decay: weight decay of AdamW.
        seed: seed of everything random; member i begins and draws its batches with seed + i.
        scratch: begin with random weights. Without it, networks for categories of which the shipped ones know
            none begin with theirs, and a tenth of the steps and samples will do.

    Raises:
        CategoryError: an unknown category.
        SettingsError: a category named twice, an unknown network or loss, or a number out of range.
    """

    categories: Positional[Categories] = ()
    network: str = "compact"
    width: float = 1.0
    members: int = 2
    loss: str = "likelihood"
    samples: int = 20_000
    held_out: int = 512
    steps: int = 10_000
    batch: int = 32
    echo: int = 2
    learning_rate: float = 1e-3
    weight_decay: float = 0.02
    seed: int = 0
    scratch: bool = False

    def __post_init__(self):
        from grasptransfer.perception.networks import network_names
        from grasptransfer.workshop.training.losses import LOSSES

        if not self.categories:
            shipped = tuple(load_category(name) for name in list_categories())
            object.__setattr__(self, "categories", shipped)
        names = [category.name for category in self.categories]
        if len(set(names)) < len(names):
            raise SettingsError("names one category twice", key="categories", value=names)
        for key, choices in (("network", network_names()), ("loss", LOSSES)):
            value = getattr(self, key)
            if value not in choices:
                raise SettingsError(f"unknown {key}", key=key, value=value, choices=choices)
        check_counts(self, "members", "samples", "held_out", "steps", "batch", "echo")
        for key in ("width", "learning_rate"):
            if not 0 < getattr(self, key) < math.inf:
                raise SettingsError("must be above 0", key=key, value=getattr(self, key))
        if not 0 <= self.weight_decay < math.inf:
            raise SettingsError("must be 0 or more", key="weight_decay", value=self.weight_decay)


@dataclass(frozen=True)
class TrainingPlace:
    """Where a training runs and what it writes; the weights do not depend on it but for rounding.

    Args:
        run: folder of data, checkpoints and logs.
        output: weight file; default: objects/models/<categories>.safetensors.

    Raises:
        SettingsError: an unknown device or precision, no workers, or a file where a folder is to be.
    """

    run: Path = Path("runs/default")
    output: Path | None = None
    device: Device = "auto"
    precision: Annotated[
        Precision, arg(help="auto, float32 or bfloat16; auto: as the device is quickest at.")
    ] = "auto"
    workers: Annotated[Workers, arg(help="rendering processes.")] = 2

    def __post_init__(self):
        choose_device(self.device)
        check_precision(self.precision)
        check_counts(self, "workers")
        if self.run.exists() and not self.run.is_dir():
            raise SettingsError("is not a folder", path=self.run, key="run")
        if self.output is not None and (self.output.suffix != ".safetensors" or self.output.is_dir()):
            raise SettingsError("must be a .safetensors file", key="output", value=str(self.output))
