"""Every estimator by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grasptransfer.errors import SettingsError
from grasptransfer.perception.precision import check_precision

if TYPE_CHECKING:
    from grasptransfer.category import Category
    from grasptransfer.perception.estimate import Estimator

ESTIMATORS = ("rgb", "rgbd", "cls", "cpd", "similarity", "rigid")


def check_device(device: str) -> None:
    """Refuse a device that is unknown, or not in this machine.

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
    """ "cpu" or "cuda"; "auto" takes a GPU where there is one."""
    check_device(device)
    if device == "auto":
        import torch

        return "cuda" if torch.cuda.is_available() else "cpu"
    return device


def make_estimator(
    estimator: str | Estimator,
    category: Category,
    *,
    refine_pose: bool = True,
    device: str = "auto",
    precision: str = "auto",
) -> Estimator:
    """The estimator of this name for a category; a callable is one already.

    Args:
        estimator: one of `ESTIMATORS`, or any callable `Observation -> ShapeEstimate`.
        refine_pose: fit the pose together with the shape, where the estimator can.
        device: "auto", "cpu" or "cuda", of networks.
        precision: "auto", "float32" or "bfloat16", of networks.

    Raises:
        SettingsError: an unknown name, device or precision.
        WeightsError: no trained network for the category.
    """
    check_device(device)
    check_precision(precision)
    if callable(estimator):
        return estimator
    if estimator in ("rgb", "rgbd"):
        from grasptransfer.perception.rgb import RgbEstimator
        from grasptransfer.perception.rgbd import RgbdEstimator

        rgb = RgbEstimator(category, refine_pose=refine_pose, device=device, precision=precision)
        return rgb if estimator == "rgb" else RgbdEstimator(category, rgb)
    from grasptransfer.perception import baselines

    if estimator == "cls":
        return baselines.ClsEstimator(category, refine_pose=refine_pose)
    if estimator == "cpd":
        return baselines.CpdEstimator(category)
    if estimator == "similarity":
        return baselines.SimilarityEstimator(category)
    if estimator == "rigid":
        return baselines.RigidEstimator(category)
    raise SettingsError("unknown estimator", key="estimator", value=estimator, choices=ESTIMATORS)
