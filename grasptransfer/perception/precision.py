"""In which numbers networks compute: answers in float32, training in what the processor is quickest at.

Answers in bfloat16 differ from those in float32 by up to 0.25 standard deviations of the latent and 0.6
degrees (30 renderings of test instances), so that processors would disagree; they take two thirds of the time
where the processor multiplies bfloat16 matrices, and eight times as long where it has to imitate that.
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
        SettingsError: there is no such precision; with those there are.
    """
    if precision not in PRECISIONS:
        raise SettingsError("unknown precision", key="precision", value=precision, choices=PRECISIONS)
    asked = os.environ.get(VARIABLE, "auto")
    if asked not in PRECISIONS:
        raise SettingsError(
            "the environment asks for an unknown precision", key=VARIABLE, value=asked, choices=PRECISIONS
        )


def answer_precision(precision: str) -> str:
    """ "float32" or "bfloat16" of a network that answers; "auto" asks the environment, then takes float32.

    Raises:
        SettingsError: an unknown precision.
    """
    return _chosen(precision) or "float32"


def training_precision(precision: str, device: str) -> str:
    """ "float32" or "bfloat16" of training; "auto" asks the environment, then what the device is quickest at.

    Args:
        precision: one of `PRECISIONS`.
        device: "cpu" or "cuda".

    Raises:
        SettingsError: an unknown precision.
    """
    return _chosen(precision) or ("bfloat16" if multiplies_bfloat16(device) else "float32")


def _chosen(precision: str) -> str | None:
    """What the argument or the environment asks for; None leaves the choice."""
    check_precision(precision)
    asked = os.environ.get(VARIABLE, "auto") if precision == "auto" else precision
    return None if asked == "auto" else asked


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
