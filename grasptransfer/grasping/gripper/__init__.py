"""A two-finger gripper: what its URDF and YAML say, checked, and where pads and links are at any opening."""

from grasptransfer.grasping.gripper.coupling import FingerJoint
from grasptransfer.grasping.gripper.links import FingerLink, Joint
from grasptransfer.grasping.gripper.load import GRIPPER_FOLDER, list_grippers, load_gripper
from grasptransfer.grasping.gripper.model import APPROACH_CLEARANCE, Gripper
from grasptransfer.grasping.gripper.pads import SIDE, Pad, PadFaces
from grasptransfer.grasping.gripper.shapes import Shape

__all__ = [
    "APPROACH_CLEARANCE",
    "GRIPPER_FOLDER",
    "SIDE",
    "FingerJoint",
    "FingerLink",
    "Gripper",
    "Joint",
    "Pad",
    "PadFaces",
    "Shape",
    "list_grippers",
    "load_gripper",
]
