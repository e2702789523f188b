"""What a transfer gives: the seen instance, and every grasp on it with its verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from grasptransfer.category import Category
    from grasptransfer.grasping import CheckStatus, Gripper, Scene
    from grasptransfer.perception.estimate import EstimateStatus
    from grasptransfer.perception.observation import Observation
    from grasptransfer.registration import DeformationField


@dataclass(frozen=True)
class TransferredGrasp:
    """An annotated grasp on the seen instance.

    Args:
        name, label: as annotated; members of a symmetry family carry their turn in the name.
        camera_from_gripper: (4, 4) TCP in the camera frame [m].
        object_from_gripper: (4, 4) TCP in the object frame [m].
        canonical_from_gripper: (4, 4) the annotated TCP [m].
        width: distance between the pads when they touch [m].
        opening: distance between the pads on the way in [m].
        score: expected success in [0, 1], over the shapes and the poses near the told one that the picture
            leaves possible, times the chance that it shows the category at all.
        status: outcome of the checks; `usable` says whether to execute it.
        reason: one sentence.
        approach_distance: of the straight way in, along +z to the TCP [m].
        confidence: of the annotation, in [0, 1].
        contacts: (2, 3) points under the -x and the +x pad, object frame [m]; None where they are not known.
    """

    name: str
    label: str
    camera_from_gripper: Float[np.ndarray, "4 4"]
    object_from_gripper: Float[np.ndarray, "4 4"]
    canonical_from_gripper: Float[np.ndarray, "4 4"]
    width: float
    opening: float
    score: float
    status: CheckStatus
    reason: str
    approach_distance: float
    confidence: float
    contacts: Float[np.ndarray, "2 3"] | None = None

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
        field: canonical to object; `field(points)` warps (m, 3) canonical points [m].
        camera_from_object: (4, 4) the pose, refined where the estimator does that.
        latent, latent_covariance: shape-space coordinates and their posterior covariance, or None.
        mask: (h, w) pixels of the object, the told mask or else the predicted one, or None.
        category_score: 1 = fits the category, 0 = does not; None where the estimator does not judge it.
        status: outcome of the shape estimate.
        timings: seconds per stage.
        category, gripper: loaded.
        observation: what was seen and told.
        scene: obstacles, or None.
    """

    grasps: tuple[TransferredGrasp, ...]
    mesh: trimesh.Trimesh
    field: DeformationField
    camera_from_object: Float[np.ndarray, "4 4"]
    latent: Float[np.ndarray, " k"] | None
    latent_covariance: Float[np.ndarray, "k k"] | None
    mask: Bool[np.ndarray, "h w"] | None
    category_score: float | None
    status: EstimateStatus
    timings: dict[str, float]
    category: Category
    gripper: Gripper
    observation: Observation
    scene: Scene | None

    @property
    def usable(self) -> tuple[TransferredGrasp, ...]:
        """The grasps that passed every check, best first."""
        return tuple(grasp for grasp in self.grasps if grasp.usable)

    def to_isaac_grasp(self, path: str | Path) -> Path:
        """Write the usable grasps as isaac_grasp YAML, object frame, TCP.

        Raises:
            SettingsError: it cannot be written.
        """
        from grasptransfer.report.result_files import write_isaac_grasp

        return write_isaac_grasp(self, Path(path))

    def save(self, folder: str | Path) -> Path:
        """Write grasps.yaml, reconstruction.glb, field.npz and result.yaml into `folder`.

        Raises:
            SettingsError: the folder cannot be written.
        """
        from grasptransfer.report.result_files import save_result

        return save_result(self, Path(folder))

    def report(self, path: str | Path, *, trials=None) -> Path:
        """Write a self-contained HTML page: picture, reconstruction, deformation, every grasp and why.

        Args:
            trials: results of `simulation.simulate`, shown beside their grasps.

        Raises:
            SettingsError: it cannot be written.
        """
        from grasptransfer.report.page import write_page

        return write_page(self, Path(path), trials=trials)
