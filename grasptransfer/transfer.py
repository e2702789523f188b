"""The main flow: RGB pictures of one object in, checked and ranked grasps out.

    observe -> estimate the shape -> warp the grasps -> refine -> check -> place -> rank

Frames: `object` is the seen instance in its category's axes, `gripper` the TCP (+z approach,
+x closing), `camera` OpenCV. See `frames.py`.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer import given
from grasptransfer.category import Category, load_category
from grasptransfer.choice import Prefer, Reachable, chosen, in_order, raise_unless_succeeded
from grasptransfer.errors import check_seed
from grasptransfer.frames import check_rigid
from grasptransfer.grasping import (
    Experience,
    Gripper,
    Physics,
    PlannedGrasps,
    Scene,
    as_physics,
    as_scene,
    expand_symmetry,
    load_grasps,
    load_gripper,
    mark_unlikely,
    plan_grasps,
    score_grasps,
)
from grasptransfer.jobs import single_blas_thread
from grasptransfer.perception import estimators
from grasptransfer.perception.estimators import ESTIMATORS, EstimatorSettings, check_several_pictures
from grasptransfer.result import TransferredGrasp, TransferResult
from grasptransfer.track import POSE_NOISE, Track

if TYPE_CHECKING:
    from grasptransfer.perception.estimate import Estimator, ShapeEstimate
    from grasptransfer.perception.observation import Observation
    from grasptransfer.perception.pose_search import FoundPose, PoseFinder

__all__ = ["ESTIMATORS", "GraspTransfer", "TransferResult", "TransferredGrasp", "transfer_grasps"]


class GraspTransfer:
    """Grasp transfer for one category; network, renderer and gripper stay warm between pictures.

    Args:
        category: name, folder or loaded `Category`.
        gripper: name, YAML path or loaded `Gripper`.
        grasps: a grasp file for this category in place of its own, or None.
        estimator: one of `ESTIMATORS`, or any callable `Observation -> ShapeEstimate`.
        refine_pose: fit the pose together with the shape, where the estimator can; without, every pose is
            taken as exact.
        device: "auto", "cpu", "openvino" or "cuda", of networks (`perception/device.py`).
        precision: "auto", "float32" or "bfloat16", of networks (`perception/precision.py`).
        seed: of the samples that rank the grasps.

    Raises:
        GraspTransferError: unknown category, gripper or estimator; missing or corrupt files.
    """

    def __init__(
        self,
        category: str | Path | Category,
        *,
        gripper: str | Path | Gripper = "panda",
        grasps: str | Path | None = None,
        estimator: str | Estimator = "rgb",
        refine_pose: bool = True,
        device: str = "auto",
        precision: str = "auto",
        seed: int = 0,
    ):
        check_seed(seed)
        self.category = load_category(category)
        self.gripper = gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
        file = self.category.annotated_path() if grasps is None else grasps
        self.grasps = expand_symmetry(load_grasps(file, category=self.category))
        self.experience = Experience.of(self.category, own_grasps=grasps is None)
        settings = EstimatorSettings(refine_pose, device, precision)
        self.estimator = estimators.make_estimator(estimator, self.category, settings)
        self._named, self.seed = estimator, seed

    def transfer(
        self,
        image: given.Pictures,
        pose: given.Poses,
        *,
        camera: given.Cameras = None,
        box: given.Boxes = None,
        mask: given.Masks = None,
        depth: given.Depths = None,
        scene: given.SomeScene = None,
        pose_sigma: given.Sigmas = None,
        views: str = "moved camera",
        world_from_camera: given.Matrix = None,
        reachable: Reachable | None = None,
        prefer: Prefer | None = None,
        physics: given.SomePhysics = None,
        strict: bool = False,
    ) -> TransferResult:
        """Transfer the annotated grasps to the instance in `image`; arguments as of `transfer_grasps`.

        Raises:
            GraspTransferError: wrong input, by argument, value and choices; `NotSucceeded` where `strict`.
        """
        from grasptransfer.perception.picture_lists import observe_all

        seen, scene = {"camera": camera, "box": box, "mask": mask}, as_scene(scene)
        support = None if scene is None else scene.support
        found = self.finder.find(image, **seen, support=support) if pose is None else ()
        if found:
            pose, pose_sigma = found[0].camera_from_object, found[0].pose_sigma
        observation = observe_all(image, pose, views=views, **seen, depth=depth, pose_sigma=pose_sigma)
        how = {"world_from_camera": world_from_camera, "physics": physics, "strict": strict}
        return self.answer(observation, scene=scene, found=found, reachable=reachable, prefer=prefer, **how)

    def track(self, *, views: str = "moved camera", pose_noise: given.Sigmas = POSE_NOISE) -> Track:
        """Follow one object from picture to picture: what each leaves known is the prior of the next.

        Args:
            views: how the poses go together, as of `transfer_grasps`.
            pose_noise: by how much their differences err from each picture to the next, as `pose_sigma`.

        Raises:
            GraspTransferError: unknown `views`, no uncertainty, or an estimator of one picture at a time.
        """
        check_several_pictures(self._named, "track")
        return Track(self.answer, views=views, pose_noise=pose_noise)

    def answer(
        self,
        observation: Observation,
        *,
        scene: given.SomeScene = None,
        world_from_camera: given.Matrix = None,
        found: tuple[FoundPose, ...] = (),
        reachable: Reachable | None = None,
        prefer: Prefer | None = None,
        physics: given.SomePhysics = None,
        strict: bool = False,
    ) -> TransferResult:
        """Transfer the annotated grasps to what was observed.

        Args:
            found: poses of `find_pose`, where none was given; the other arguments are `transfer_grasps`'s.
        """
        if observation.further:
            check_several_pictures(self._named, "image")
        scene = as_scene(scene)
        if scene is not None:
            observation = replace(observation, support=scene.support)
        if world_from_camera is not None:
            world_from_camera = check_rigid(world_from_camera, "world_from_camera")
        clock = time.perf_counter()
        estimate = self.estimator(observation)
        estimated = time.perf_counter()
        stands = {"scene": scene, "world_from_camera": world_from_camera}
        result = self.grasp(observation, estimate, **stands, physics=physics)
        result = chosen(result, found=found, reachable=reachable, prefer=prefer)
        spent = {"shape": estimated - clock, "grasps": time.perf_counter() - estimated}
        result = replace(result, timings=result.timings | spent | {"total": sum(spent.values())})
        if strict:
            raise_unless_succeeded(result)
        return result

    @cached_property
    def finder(self) -> PoseFinder:
        """Finds the pose in pictures that come without one."""
        from grasptransfer.perception.pose_search import PoseFinder

        return PoseFinder(self.category, estimator=self.estimator)

    def grasp(
        self,
        observation: Observation,
        estimate: ShapeEstimate,
        *,
        scene: Scene | None = None,
        world_from_camera: Float[np.ndarray, "4 4"] | None = None,
        physics: given.SomePhysics = None,
    ) -> TransferResult:
        """Warp, refine, check, place and rank the grasps on an estimated shape.

        Args:
            scene, world_from_camera, physics: as of `transfer_grasps`.
        """
        physics = as_physics(physics).standing(scene, world_from_camera)
        with single_blas_thread():
            planned = self.plan(estimate, scene=scene, physics=physics)
            start, pose = time.perf_counter(), estimate.camera_from_object
            known = {"plausible": planned.plausible, "experience": self.experience}
            found = score_grasps(planned.grasps, planned.checks, self.gripper, **known)
        trust = estimate.trust
        scores = [round(trust * one.chance, 6) for one in found]  # no order by the last bits
        checks = mark_unlikely(planned.checks, scores, trust=trust)
        timings = estimate.timings | planned.timings | {"rank": time.perf_counter() - start}
        seen = pose, self.gripper, world_from_camera
        grasps = [
            TransferredGrasp(warped, check, score, *seen, trust * one.deviation, physics.up)
            for warped, check, score, one in zip(planned.grasps, checks, scores, found, strict=True)
        ]
        return TransferResult(
            grasps=in_order(grasps),
            mesh=planned.mesh,
            estimate=estimate,
            timings=timings,
            category=self.category,
            gripper=self.gripper,
            observation=observation,
            scene=scene,
        )

    def plan(self, estimate: ShapeEstimate, *, scene=None, physics: Physics | None = None) -> PlannedGrasps:
        """Warp, refine, check and place the grasps on an estimated shape: all but their ranking."""
        known = {"scene": scene, "physics": physics, "seed": self.seed}
        return plan_grasps(self.grasps, estimate, self.category, gripper=self.gripper, **known)


def transfer_grasps(
    image: given.Pictures,
    pose: given.Poses,
    category: str | Path | Category,
    *,
    camera: given.Cameras = None,
    gripper: str | Path | Gripper = "panda",
    grasps: str | Path | None = None,
    box: given.Boxes = None,
    mask: given.Masks = None,
    depth: given.Depths = None,
    scene: given.SomeScene = None,
    estimator: str | Estimator = "rgb",
    pose_sigma: given.Sigmas = None,
    refine_pose: bool = True,
    views: str = "moved camera",
    world_from_camera: given.Matrix = None,
    reachable: Reachable | None = None,
    prefer: Prefer | None = None,
    physics: given.SomePhysics = None,
    device: str = "auto",
    precision: str = "auto",
    seed: int = 0,
    strict: bool = False,
) -> TransferResult:
    """Transfer a category's annotated grasps to the instance seen in RGB pictures.

    For many objects keep a `GraspTransfer`: it loads the network once.

    Args:
        image: path, PIL picture or uint8 (h, w, 3) RGB; or a list of them, all of one object. Then `pose`,
            and `box`, `mask` and `depth` where given, are lists of the same length; `camera` and `pose_sigma`
            may be. The result is in the frame of the first picture's camera, and so is the scene.
        pose: (4, 4) `camera_from_object`, OpenCV axes, metres; or None: it is searched in the box or mask
            (`find_pose`), and the result's `found_poses` and `pose_note` say how likely it is.
        category: name, folder or loaded `Category`.
        camera: `Camera`, path of a camera file, 3x3 intrinsics [px], or None for a 60 degree field of view.
        gripper: name, YAML path or loaded `Gripper`.
        grasps: a grasp file for this category in place of its own, or None.
        box: (u0, v0, u1, v1) around the object [px], as a detector gives it, or None.
        mask: bool (h, w) of what is seen of the object, taken as it is; or a segmenter or detector, a
            callable from the picture, uint8 (h, w, 3) RGB, to mask or box; or None.
        depth: (h, w) metres, 0 = missing; for the estimators that use depth.
        scene: obstacles and a support plane, on which the object may stand, or the path of a YAML; optional.
        estimator: one of `ESTIMATORS`, or any callable `Observation -> ShapeEstimate`.
        pose_sigma: how sure the pose is: None, as those of real estimators (`perception/pose_prior.py`); 0,
            exact; (translation [m], rotation [deg]), standard deviations along and about each axis; or a
            (6, 6) covariance, turn [rad] about the object's origin, then shift [m], along camera axes.
        refine_pose: fit the pose together with the shape; without, the pose is taken as exact.
        views: of several pictures. "moved camera": the object stood still and the camera's way is known, so
            that one error, that of the first pose, is common to all; "separate": each pose errs by itself.
        world_from_camera: (4, 4) where the camera stands [m], or None; with it every grasp has
            `world_from_gripper`.
        reachable: callback on `world_from_gripper` (4, 4) [m]: does the robot reach it? Other
            grasps get the status OUT_OF_REACH. It needs `world_from_camera`.
        prefer: the grasp chosen last, or a direction (3,) to come in along (`choice.py`).
        physics: mass, friction, force and up, as far as known: `Physics`, or a mapping of its fields.
        device: "auto", "cpu", "openvino" or "cuda", of networks (`perception/device.py`).
        precision: "auto", "float32" or "bfloat16", of networks (`perception/precision.py`).
        seed: of the samples that rank the grasps.
        strict: raise `NotSucceeded` where the instance does not fit the category or no grasp is usable.

    Raises:
        GraspTransferError: wrong input; one sentence with the argument, the value and the choices.
    """
    made = {"gripper": gripper, "grasps": grasps, "estimator": estimator, "refine_pose": refine_pose}
    flow = GraspTransfer(category, **made, device=device, precision=precision, seed=seed)
    seen = {"camera": camera, "box": box, "mask": mask, "depth": depth, "scene": scene}
    known = {"pose_sigma": pose_sigma, "views": views, "world_from_camera": world_from_camera}
    wanted = {"reachable": reachable, "prefer": prefer, "physics": physics}
    return flow.transfer(image, pose, **seen, **known, **wanted, strict=strict)
