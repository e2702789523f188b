"""Where networks compute: on the processor, or on a GPU."""

from grasptransfer.errors import SettingsError


def check_device(device: str) -> None:
    """Refuse a device that is unknown, or not in this machine.

    Args:
        device: "auto", "cpu" or "cuda".

    Raises:
        SettingsError: with the devices there are.
    """
    if device in ("auto", "cpu"):
        return
    import torch

    here = ("auto", "cpu", "cuda") if torch.cuda.is_available() else ("auto", "cpu")
    if device not in here:
        problem = "is not in this machine" if device == "cuda" else "unknown device"
        raise SettingsError(problem, key="device", value=device, choices=here)


def choose_device(device: str) -> str:
    """The device to compute on, "cpu" or "cuda"; "auto" takes a GPU where there is one.

    Raises:
        SettingsError: an unknown device, or one that is not in this machine.
    """
    check_device(device)
    if device == "auto":
        import torch

        return "cuda" if torch.cuda.is_available() else "cpu"
    return device
