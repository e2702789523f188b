"""In which numbers a network computes: bfloat16 where such matrices are multiplied, float32 elsewhere.

Without such instructions bfloat16 is emulated, and a network takes eight times as long as in float32.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    import torch

PRECISIONS = ("auto", "float32", "bfloat16")
VARIABLE = "GRASPTRANSFER_PRECISION"  # of the environment; stands in for "auto"
MATRIX_INSTRUCTIONS = ("avx512_bf16", "amx_bf16")  # cpuinfo's names, also those of Linux


def check_precision(precision: str) -> None:
    """Refuse a precision that is unknown, as an argument or in the environment.

    Raises:
        SettingsError: with the precisions there are.
    """
    if precision not in PRECISIONS:
        raise SettingsError("unknown precision", key="precision", value=precision, choices=PRECISIONS)
    asked = os.environ.get(VARIABLE, "auto")
    if asked not in PRECISIONS:
        raise SettingsError(
            "the environment asks for an unknown precision", key=VARIABLE, value=asked, choices=PRECISIONS
        )


def choose_precision(precision: str, device: str) -> str:
    """ "float32" or "bfloat16"; "auto" asks the environment, then what the device has instructions for.

    Args:
        precision: one of `PRECISIONS`.
        device: "cpu" or "cuda".

    Raises:
        SettingsError: an unknown precision.
    """
    check_precision(precision)
    if precision == "auto":
        precision = os.environ.get(VARIABLE, "auto")
    if precision != "auto":
        return precision
    return "bfloat16" if multiplies_bfloat16(device) else "float32"


def multiplies_bfloat16(device: str) -> bool:
    """Whether "cpu" or "cuda" has instructions that multiply bfloat16 matrices."""
    import torch

    if device == "cuda":
        return torch.cuda.get_device_capability() >= (8, 0)  # from Ampere on
    return any(name in _processor_flags() for name in MATRIX_INSTRUCTIONS)


def arithmetic(device: torch.device, precision: str) -> AbstractContextManager:
    """Within it networks compute in "float32" or "bfloat16"; it holds for the thread that enters it."""
    import torch

    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=precision == "bfloat16")


def _processor_flags() -> set[str]:
    """Names of the processor's instruction sets; of torch before 2.11 only what Linux says."""
    import torch

    ask = getattr(torch.cpu, "get_capabilities", None)
    if ask is not None:
        return {name for name, present in ask().items() if present is True}
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    return {flag for line in lines if line.startswith("flags") for flag in line.split(":")[1].split()}
