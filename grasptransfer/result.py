"""What a transfer gives: the seen instance, and every grasp on it with its verdict."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from grasptransfer.category import Category
    from grasptransfer.grasping import CheckStatus, GraspCheck, Gripper, Scene, WarpedGrasp
    from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
    from grasptransfer.perception.observation import Observation
    from grasptransfer.perception.pose_prior import PoseDeviation
    from grasptransfer.perception.pose_search import FoundPose
    from grasptransfer.registration import DeformationField
    from grasptransfer.simulation import TrialResult
    from grasptransfer.waypoints import Waypoints


@dataclass(frozen=True)
class TransferredGrasp:
    """An annotated grasp on the seen instance, and the verdict about it.

    Args:
        warped: the annotated grasp, moved to the instance, refined and placed.
        check: whether the gripper reaches it and closes on the object.
        score: expected success in [0, 1], over the shapes and the poses near the given one that the picture
            leaves possible, times the chance that it shows the category at all.
        camera_from_object: (4, 4) pose of the instance [m].
        gripper: that executes it.
        world_from_camera: (4, 4) where the camera stands [m], or None where it was not given.
        score_deviation: standard deviation of `score` under another seed: it is a mean over a few draws.
        up_camera: unit, against gravity, camera frame; None where nothing tells: the object's z axis.
    """

    warped: WarpedGrasp
    check: GraspCheck
    score: float
    camera_from_object: Float[np.ndarray, "4 4"]
    gripper: Gripper
    world_from_camera: Float[np.ndarray, "4 4"] | None = None
    score_deviation: float = 0.0
    up_camera: Float[np.ndarray, 3] | None = None

    @property
    def name(self) -> str:
        """As annotated; members of a symmetry family carry their turn in it."""
        return self.warped.source.name

    @property
    def label(self) -> str:
        """What the grasp is for, as annotated."""
        return self.warped.source.label

    @property
    def canonical_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) the annotated TCP [m]."""
        return self.warped.source.canonical_from_gripper

    @property
    def object_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) TCP in the object frame [m]."""
        return self.warped.object_from_gripper

    @property
    def camera_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) TCP in the camera frame [m]."""
        return self.camera_from_object @ self.warped.object_from_gripper

    @property
    def world_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) TCP in the world frame [m].

        Raises:
            SettingsError: `world_from_camera` was not given.
        """
        if self.world_from_camera is None:
            raise SettingsError("was not given", key="world_from_camera", fix="Pass it to transfer_grasps")
        return self.world_from_camera @ self.camera_from_gripper

    def waypoints(self) -> Waypoints:
        """Pre-grasp, grasp and lift of the TCP, in the world where it is known, else in the camera's frame.

        The lift goes up the world's z axis; in the camera's frame, away from the support plane, or without
        one, up the object's z axis.
        """
        from grasptransfer.waypoints import waypoints

        if self.world_from_camera is None:
            frame, pose = "camera", self.camera_from_gripper
            up = self.camera_from_object[:3, 2] if self.up_camera is None else self.up_camera
        else:
            frame, pose, up = "world", self.world_from_gripper, np.array([0.0, 0.0, 1.0])
        return waypoints(
            frame,
            pose,
            up,
            approach_distance=self.approach_distance,
            opening=self.opening,
            width=self.width,
        )

    def to_moveit(self, *, frame_id: str | None = None) -> dict:
        """The grasp in the layout of `moveit_msgs/Grasp`; `grasp_pose` is that of the gripper's base link.

        Args:
            frame_id: name in the robot's tf tree of the frame of `waypoints`; None: "world" or "camera".
        """
        from grasptransfer.waypoints import moveit_grasp

        return moveit_grasp(self.name, self.score, self.waypoints(), self.gripper, frame_id=frame_id)

    @property
    def width(self) -> float:
        """Distance between the pads when they touch [m]."""
        return self.warped.width

    @property
    def opening(self) -> float:
        """Distance between the pads on the way in [m]."""
        return self.check.opening

    @property
    def contacts(self) -> Float[np.ndarray, "2 3"] | None:
        """(2, 3) points under the -x and the +x pad, object frame [m]; None where they are not known."""
        return self.warped.contacts

    @property
    def approach_distance(self) -> float:
        """Of the straight way in, along +z to the TCP [m]."""
        return self.warped.source.approach_distance

    @property
    def confidence(self) -> float:
        """Of the annotation, in [0, 1]."""
        return self.warped.source.confidence

    @property
    def status(self) -> CheckStatus:
        """Outcome of the checks; `usable` says whether to execute the grasp."""
        return self.check.status

    @property
    def reason(self) -> str:
        """The verdict in one sentence."""
        return self.check.reason

    @property
    def usable(self) -> bool:
        """Whether it passed every check."""
        return self.status.usable


@dataclass(frozen=True)
class TransferResult:
    """All grasps on the seen instance, and the instance itself.

    Args:
        grasps: best first; those that failed a check come last and say why.
        mesh: reconstruction of the instance, object frame [m].
        estimate: shape and pose, as the estimator gave them.
        timings: seconds per stage.
        category, gripper: loaded.
        observation: what was seen and given.
        scene: obstacles, or None.
        found_poses: where no pose was given, those that were found in the picture, the one taken first.
    """

    grasps: tuple[TransferredGrasp, ...]
    mesh: trimesh.Trimesh
    estimate: ShapeEstimate
    timings: dict[str, float]
    category: Category
    gripper: Gripper
    observation: Observation
    scene: Scene | None
    found_poses: tuple[FoundPose, ...] = ()

    @property
    def pose_note(self) -> str | None:
        """One sentence where the pose was found, not given: how likely it is, and what else may be."""
        if not self.found_poses:
            return None
        taken, *others = self.found_poses
        note = f"No pose was given: one was found in the picture, right with a chance of {taken.chance:.0%}"
        if others:
            note += f"; {len(others)} other{'s are' if len(others) > 1 else ' is'} possible"
        return f"{note} (scores contain this chance)."

    @property
    def usable(self) -> tuple[TransferredGrasp, ...]:
        """The grasps that passed every check, best first."""
        return tuple(grasp for grasp in self.grasps if grasp.usable)

    @property
    def field(self) -> DeformationField:
        """Canonical to object; `field(points)` warps (m, 3) canonical points [m]."""
        return self.estimate.field

    @property
    def camera_from_object(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) the pose [m], refined where the estimator does that."""
        return self.estimate.camera_from_object

    @property
    def latent(self) -> Float[np.ndarray, " k"] | None:
        """(k,) shape-space coordinates [standard deviations], where the estimator has them."""
        return self.estimate.latent

    @property
    def latent_covariance(self) -> Float[np.ndarray, "k k"] | None:
        """(k, k) posterior covariance of `latent`, where the estimator has it."""
        return self.estimate.latent_covariance

    @property
    def pose_sigma_prior(self) -> PoseDeviation | None:
        """How sure the given pose was taken to be; None where it was exact, or the estimator asks none."""
        return self.estimate.pose_sigma_prior

    @property
    def pose_sigma_posterior(self) -> PoseDeviation | None:
        """How sure the pose is, the picture seen; None where the estimator does not say."""
        return self.estimate.pose_sigma_posterior

    @property
    def mask(self) -> Bool[np.ndarray, "h w"] | None:
        """(h, w) where the object is seen in the first picture: the given mask, or the predicted one."""
        return self.estimate.mask

    @cached_property
    def silhouette(self) -> Bool[np.ndarray, "h w"]:
        """(h, w) pixels of the reconstruction at the refined pose in the first picture, hidden parts too."""
        from grasptransfer.drawing.visible import visible_faces

        vertices, faces = np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces)
        return visible_faces(vertices, faces, self.observation.camera, self.camera_from_object).mask

    @property
    def category_score(self) -> float | None:
        """Chance that the picture shows the category as pose, camera and box say, or None: not judged."""
        return self.estimate.category_score

    @property
    def status(self) -> EstimateStatus:
        """Outcome of the shape estimate."""
        return self.estimate.status

    @property
    def advice(self) -> str:
        """What to do: the advice of the status, and what seems to be wrong with the input."""
        return self.estimate.advice

    def to_isaac_grasp(self, path: str | Path) -> Path:
        """Write the usable grasps as isaac_grasp YAML, object frame, TCP.

        Raises:
            SettingsError: it cannot be written.
        """
        from grasptransfer.report.result_files import write_isaac_grasp

        return write_isaac_grasp(self, Path(path))

    def save(self, folder: str | Path) -> Path:
        """Write grasps.yaml, reconstruction.glb, field.npz, result.yaml and silhouette.png into `folder`.

        Raises:
            SettingsError: the folder cannot be written.
        """
        from grasptransfer.report.result_files import save_result

        return save_result(self, Path(folder))

    def report(self, path: str | Path, *, trials: Sequence[TrialResult] | None = None) -> Path:
        """Write a self-contained HTML page: picture, reconstruction, deformation, every grasp and why.

        Args:
            trials: results of `simulation.simulate`, shown beside their grasps.

        Raises:
            SettingsError: it cannot be written.
        """
        from grasptransfer.report.page import write_page

        return write_page(self, Path(path), trials=trials)
