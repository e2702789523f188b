"""Pose and box of an object against the truth: the measures of category-level pose estimation.

IoU compares the boxes around the objects, each along its object's axes. One picture without depth does not
tell size from distance; NIoU leaves that out: both poses and boxes are first divided by the diagonal of their
own box (Zhang et al., LaPose, ECCV 2024). Of a body of revolution, such as most bottles, the turn about its
axis does not count (Wang et al., NOCS, CVPR 2019), nor does any other that leaves the object as it looks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.result import TransferResult
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


# What counts as well placed, by its name in summaries.
LIMITS: dict[str, Callable[[PlacedScore], bool]] = {
    "iou50": lambda score: score.iou >= 0.5,
    "iou75": lambda score: score.iou >= 0.75,
    "niou50": lambda score: score.niou >= 0.5,
    "niou75": lambda score: score.niou >= 0.75,
    "deg10_cm10": lambda score: score.degrees <= 10 and score.millimetres <= 100,
    "deg5_cm5": lambda score: score.degrees <= 5 and score.millimetres <= 50,
}


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
        scaled = _divided(found, sizes[0]), _divided(true, sizes[1])
        boxes = {"found_bounds": bounds / sizes[0], "true_bounds": self.bounds / sizes[1]}
        normalised = pose_error(scaled[0], scaled[1], self.turns, **boxes)
        return PlacedScore(1e3 * error.metres, error.degrees, error.iou, normalised.iou)


@dataclass
class PlacedScores:
    """Scores of transfers of one object, before and after the pose was refined.

    Before, the canonical model stands at the given pose.
    """

    truth: PlacedTruth
    before: list[PlacedScore] = field(default_factory=list)
    after: list[PlacedScore] = field(default_factory=list)

    def add(self, result: TransferResult, true: Float[np.ndarray, "4 4"]) -> None:
        """Add a transfer whose true `camera_from_object` [m] is known."""
        given, canonical = result.observation.camera_from_object, result.category.canonical.bounds
        self.before.append(self.truth.score(given, np.asarray(canonical), true))
        self.after.append(self.truth.score(result.camera_from_object, np.asarray(result.mesh.bounds), true))

    def summary(self) -> dict[str, float]:
        """Shares within the usual limits, after refinement and before."""
        return summarise_placed(self.after) | summarise_placed(self.before, "_before")


def mean_shares(rows: Sequence[dict]) -> dict[str, float]:
    """Means of the rows' shares within the usual limits; rows without them do not count."""
    means = {}
    for name in (*LIMITS, *(f"{name}_before" for name in LIMITS)):
        values = [row[name] for row in rows if row.get(name) is not None]
        if values:
            means[name] = float(np.mean(values))
    return means


def bounds_of(points: Float[np.ndarray, "m 3"]) -> Bounds:
    """Corners of the box around points."""
    return np.stack([points.min(axis=0), points.max(axis=0)])


def summarise_placed(scores: Sequence[PlacedScore], when: str = "") -> dict[str, float]:
    """Shares within the usual limits.

    Args:
        when: ending of every name, such as "_before".
    """
    return {
        f"{name}{when}": float(np.mean([holds(score) for score in scores])) for name, holds in LIMITS.items()
    }


def _divided(pose: Float[np.ndarray, "4 4"], size: float) -> Float[np.ndarray, "4 4"]:
    scaled = pose.copy()
    scaled[:3, 3] /= size
    return scaled
