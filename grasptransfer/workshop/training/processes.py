"""One process or several that train together (torchrun), each with a device of its own."""

import os
from dataclasses import dataclass
from datetime import timedelta

import torch

from grasptransfer.perception.precision import training_precision

LONGEST_RENDERING = timedelta(days=2)  # for which the other processes wait for the first one


@dataclass(frozen=True)
class Place:
    """Which of how many processes this one is, its device, and the numbers it computes in."""

    rank: int
    world: int
    device: torch.device
    precision: str = "float32"

    @property
    def first(self) -> bool:
        """Whether it is the one that renders and writes for all."""
        return self.rank == 0


def join_processes(device: str, precision: str = "auto") -> Place:
    """This process among those that torchrun started; without it, alone.

    Args:
        device: "cpu" or "cuda"; of several GPUs each process of a machine takes its own.
        precision: "auto", "float32" or "bfloat16".
    """
    rank, world = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
    own = torch.device(device)
    if world > 1 and device == "cuda":
        own = torch.device(device, int(os.environ["LOCAL_RANK"]))
        torch.cuda.set_device(own)
    if world > 1 and not torch.distributed.is_initialized():
        backend = "nccl" if device == "cuda" else "gloo"
        torch.distributed.init_process_group(backend, timeout=LONGEST_RENDERING)
    return Place(rank, world, own, training_precision(precision, device))
