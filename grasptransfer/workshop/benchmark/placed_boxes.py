"""Pose and box of an object against the truth: the measures of category-level pose estimation.

IoU compares the boxes around the objects, each along its object's axes. One picture without depth does not
tell size from distance; NIoU leaves that out: both poses and boxes are first divided by the diagonal of their
own box (Zhang et al., LaPose, ECCV 2024). Of a body of revolution, such as most bottles, the turn about its
axis does not count (Wang et al., NOCS, CVPR 2019), nor does any other that leaves the object as it looks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.workshop.benchmark.pose_errors import pose_error, symmetry_turns

Bounds = Float[np.ndarray, "2 3"]


@dataclass(frozen=True)
class PlacedScore:
    """How well an object was placed.

    Args:
        millimetres: distance between the objects' origins.
        degrees: angle between the poses.
        iou, niou: of the boxes.
    """

    millimetres: float
    degrees: float
    iou: float
    niou: float


@dataclass(frozen=True)
class PlacedTruth:
    """The box of an object, and the turns about its z axis that do not show.

    Args:
        bounds: corners, object frame [m].
        turns: [rad].
    """

    bounds: Bounds
    turns: tuple[float, ...]

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> "PlacedTruth":
        """Of the true mesh, object frame [m]."""
        return cls(np.asarray(mesh.bounds), symmetry_turns(mesh))

    def score(
        self, found: Float[np.ndarray, "4 4"], bounds: Bounds, true: Float[np.ndarray, "4 4"]
    ) -> PlacedScore:
        """Compare an estimate with the truth.

        Args:
            found, true: (4, 4) `camera_from_object` [m].
            bounds: corners of the reconstruction's box, object frame [m].
        """
        error = pose_error(found, true, self.turns, found_bounds=bounds, true_bounds=self.bounds)
        sizes = [float(np.linalg.norm(box[1] - box[0])) for box in (bounds, self.bounds)]
        scaled = [_divided(pose, size) for pose, size in zip((found, true), sizes, strict=True)]
        boxes = {"found_bounds": bounds / sizes[0], "true_bounds": self.bounds / sizes[1]}
        normalised = pose_error(*scaled, self.turns, **boxes)
        return PlacedScore(1e3 * error.metres, error.degrees, error.iou, normalised.iou)


def bounds_of(points: Float[np.ndarray, "m 3"]) -> Bounds:
    """Corners of the box around points."""
    return np.stack([points.min(axis=0), points.max(axis=0)])


def summarise_placed(scores: Sequence[PlacedScore], when: str = "") -> dict[str, float]:
    """Means, and shares within the usual limits.

    Args:
        when: ending of every name, such as "_before".
    """
    shift, turn, iou, niou = (
        np.array([getattr(score, name) for score in scores])
        for name in ("millimetres", "degrees", "iou", "niou")
    )
    found = {
        "iou50": iou >= 0.5,
        "iou75": iou >= 0.75,
        "niou50": niou >= 0.5,
        "niou75": niou >= 0.75,
        "deg10_cm10": (turn <= 10) & (shift <= 100),
        "deg5_cm5": (turn <= 5) & (shift <= 50),
    }
    return {f"{name}{when}": float(np.mean(values)) for name, values in found.items()}


def _divided(pose: Float[np.ndarray, "4 4"], size: float) -> Float[np.ndarray, "4 4"]:
    scaled = pose.copy()
    scaled[:3, 3] /= size
    return scaled
