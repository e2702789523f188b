"""From a shape estimate to planned grasps: the stages between the estimate and the ranking, in order."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grasptransfer.grasping.collision import GraspCheck, check_grasps
from grasptransfer.grasping.physics import Physics
from grasptransfer.grasping.placement import place_grasps
from grasptransfer.grasping.plausible import PlausibleObjects, surface_places
from grasptransfer.grasping.refine import refine_grasps
from grasptransfer.grasping.warping import WarpedGrasp, warp_grasps
from grasptransfer.grasping.world import CollisionWorld
from grasptransfer.perception.reconstruction import reconstruct

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category
    from grasptransfer.grasping.grasp import Grasp
    from grasptransfer.grasping.gripper import Gripper
    from grasptransfer.grasping.scene import Scene
    from grasptransfer.perception.estimate import ShapeEstimate


@dataclass(frozen=True)
class PlannedGrasps:
    """Transferred grasps before their ranking.

    Args:
        mesh: the reconstruction, object frame [m].
        grasps: the grasps, refined and placed, object frame.
        checks: the check of each grasp.
        plausible: objects that the picture leaves possible.
        timings: seconds per stage.
    """

    mesh: trimesh.Trimesh
    grasps: tuple[WarpedGrasp, ...]
    checks: tuple[GraspCheck, ...]
    plausible: PlausibleObjects
    timings: dict[str, float]


def plan_grasps(
    annotated: Sequence[Grasp],
    estimate: ShapeEstimate,
    category: Category,
    *,
    gripper: Gripper,
    scene: Scene | None = None,
    physics: Physics | None = None,
    seed: int = 0,
) -> PlannedGrasps:
    """Warp, refine, check and place the grasps on an estimated shape: all but their ranking.

    Args:
        annotated: grasps of the category, every member of a symmetric family by itself.
        estimate: shape and pose of the seen instance.
        category: the category of both.
        gripper: the gripper that executes the grasps.
        scene: obstacles and a support plane, camera frame.
        physics: mass, friction and force, and how sure they are.
        seed: seed of the drawn plausible objects.
    """
    timings, last = {}, time.perf_counter()

    def lap(stage: str):
        nonlocal last
        now = time.perf_counter()
        timings[stage], last = now - last, now

    mesh = reconstruct(category, estimate.field, latent=estimate.latent)
    points = surface_places(mesh, category)[0].points(mesh)
    world = CollisionWorld(mesh, scene, estimate.camera_from_object, points=points)
    lap("reconstruct")
    warped = warp_grasps(annotated, estimate.field)
    lap("warp")
    refined = refine_grasps(warped, world, gripper)
    lap("refine")
    checks = check_grasps(refined, world, gripper, latent=estimate.latent)
    lap("check")
    physics = (physics or Physics()).standing(scene).held_by(gripper.force_limit)
    up = None if physics.up is None else physics.up @ estimate.camera_from_object[:3, :3]
    plausible = PlausibleObjects.draw(mesh, category, estimate, physics=physics, up=up, seed=seed)
    lap("doubt")
    grasps, checks = place_grasps(refined, checks, world, gripper, plausible=plausible)
    lap("place")
    return PlannedGrasps(mesh, grasps, checks, plausible, timings)
