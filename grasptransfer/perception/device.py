"""Where networks compute: on the processor, by PyTorch or by OpenVINO, or on a GPU."""

import ctypes
import importlib.util
import os
import sys

from grasptransfer.errors import SettingsError

DEVICES = ("auto", "cpu", "openvino", "cuda")
VARIABLE = "GRASPTRANSFER_DEVICE"  # of the environment; stands in for "auto" of networks that answer


def check_device(device: str) -> None:
    """Refuse a device that is unknown, or not in this machine.

    Args:
        device: one of `DEVICES`.

    Raises:
        SettingsError: there is no such device; with those there are.
    """
    _check(device, "device")


def answering_device(device: str, *, openvino_serves: bool = True) -> str:
    """Where a network answers: "cpu" (PyTorch), "openvino" or "cuda".

    Args:
        device: one of `DEVICES`; "auto" asks the environment, then takes a GPU where there is one, else
            OpenVINO where it is installed and serves the network.

    Raises:
        SettingsError: a device that is unknown or not in this machine, also in the environment.
    """
    _check(device, "device")
    if device == "auto":
        device = os.environ.get(VARIABLE, "auto")
        _check(device, VARIABLE)
    if device != "auto":
        return device
    if _has_gpu():
        return "cuda"
    return "openvino" if openvino_serves and _has_openvino() else "cpu"


def choose_device(device: str) -> str:
    """The device to train on, "cpu" or "cuda"; "auto" takes a GPU where there is one.

    Raises:
        SettingsError: an unknown device, or one that is not in this machine or does not train.
    """
    _check(device, "device")
    if device == "openvino":
        choices = tuple(name for name in _devices_here() if name != device)
        raise SettingsError("does not train networks", key="device", value=device, choices=choices)
    if device == "auto":
        return "cuda" if _has_gpu() else "cpu"
    return device


def _check(device: str, key: str) -> None:
    if device in ("auto", "cpu"):
        return
    here = _devices_here()
    if device == "openvino" and device not in here:
        fix = "Install it: pip install 'grasptransfer[fast]'"
        raise SettingsError("is not installed", key=key, value=device, choices=here, fix=fix)
    if device not in here:
        problem = "is not in this machine" if device in DEVICES else "unknown device"
        raise SettingsError(problem, key=key, value=device, choices=here)


def _devices_here() -> tuple[str, ...]:
    missing = {"openvino": not _has_openvino(), "cuda": not _has_gpu()}
    return tuple(name for name in DEVICES if not missing.get(name, False))


def _has_openvino() -> bool:
    return importlib.util.find_spec("openvino") is not None


def _has_gpu() -> bool:
    """Whether PyTorch has a GPU; it is imported for the question only where the driver is installed."""
    if sys.platform == "linux" and "torch" not in sys.modules:
        try:
            ctypes.CDLL("libcuda.so.1")
        except OSError:
            return False
    import torch

    return torch.cuda.is_available()
