"""Annotated grasps, a gripper and a `ShapeEstimate` in; warped, refined, checked, placed, ranked grasps out.

`canonical_from_gripper` is what a person annotates, `object_from_gripper` what a robot executes; the
gripper frame is the TCP between the pads, +z approach, +x closing. Grasp files of this and other projects
are read by `grasps` and `formats`, grippers by `gripper`.
"""

from grasptransfer.grasping.collision import CheckStatus, GraspCheck, check_grasps
from grasptransfer.grasping.experience import Experience
from grasptransfer.grasping.grasps import (
    Grasp,
    GraspFile,
    Symmetry,
    expand_symmetry,
    load_grasps,
    read_grasp_file,
    save_grasps,
)
from grasptransfer.grasping.gripper import Gripper, list_grippers, load_gripper
from grasptransfer.grasping.physics import Physics, as_physics
from grasptransfer.grasping.placed_grasp import PlacedGrasp, placed_at
from grasptransfer.grasping.placement import place_grasps
from grasptransfer.grasping.planning import PlannedGrasps, plan_grasps
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.ranking import mark_unlikely, rank_grasps, score_grasps
from grasptransfer.grasping.refine import refine_grasps
from grasptransfer.grasping.scene import Scene, as_scene, load_scene
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import WarpedGrasp, on_canonical, warp_grasps
from grasptransfer.grasping.world import CollisionWorld

__all__ = [
    "CheckStatus",
    "CollisionWorld",
    "Experience",
    "Grasp",
    "GraspCheck",
    "GraspFile",
    "Gripper",
    "Physics",
    "PlacedGrasp",
    "PlannedGrasps",
    "PlausibleObjects",
    "Scene",
    "Surface",
    "Symmetry",
    "WarpedGrasp",
    "as_physics",
    "as_scene",
    "check_grasps",
    "expand_symmetry",
    "list_grippers",
    "load_grasps",
    "load_gripper",
    "load_scene",
    "mark_unlikely",
    "on_canonical",
    "place_grasps",
    "placed_at",
    "plan_grasps",
    "rank_grasps",
    "read_grasp_file",
    "refine_grasps",
    "save_grasps",
    "score_grasps",
    "warp_grasps",
]
