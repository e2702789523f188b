"""Annotate grasps once per category; transfer them to new instances seen in one RGB picture."""

import os
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from grasptransfer.camera import Camera as Camera
    from grasptransfer.category import Category as Category
    from grasptransfer.category import list_categories as list_categories
    from grasptransfer.category import load_category as load_category
    from grasptransfer.errors import GraspTransferError as GraspTransferError
    from grasptransfer.grasping import Physics as Physics
    from grasptransfer.grasping import Scene as Scene
    from grasptransfer.grasping import list_grippers as list_grippers
    from grasptransfer.grasping import load_gripper as load_gripper
    from grasptransfer.grasping import load_scene as load_scene
    from grasptransfer.pairs import register_pair as register_pair
    from grasptransfer.perception.pose_search import FoundPose as FoundPose
    from grasptransfer.perception.pose_search import find_pose as find_pose
    from grasptransfer.poses import load_pose as load_pose
    from grasptransfer.result import TransferResult as TransferResult
    from grasptransfer.simulation import simulate as simulate
    from grasptransfer.transfer import GraspTransfer as GraspTransfer
    from grasptransfer.transfer import transfer_grasps as transfer_grasps

__version__ = "0.1.0"

# OpenMP's threads wait by spinning unless told not to before torch loads: beside any other busy process, a
# network then takes ten times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# Loaded on first use: importing the package takes milliseconds.
_HOMES = {
    "Camera": "camera",
    "Category": "category",
    "FoundPose": "perception.pose_search",
    "GraspTransfer": "transfer",
    "GraspTransferError": "errors",
    "Physics": "grasping",
    "Scene": "grasping",
    "TransferResult": "result",
    "find_pose": "perception.pose_search",
    "list_categories": "category",
    "list_grippers": "grasping",
    "load_category": "category",
    "load_gripper": "grasping",
    "load_pose": "poses",
    "load_scene": "grasping",
    "register_pair": "pairs",
    "simulate": "simulation",
    "transfer_grasps": "transfer",
}
__all__ = ["__version__", *_HOMES]  # pyright: ignore[reportUnsupportedDunderAll]  it does not read _HOMES


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module 'grasptransfer' has no attribute {name!r}")
    return getattr(import_module(f"grasptransfer.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
