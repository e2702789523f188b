"""What every estimator returns: the field from canonical to instance, and how sure it is."""

import dataclasses
import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.perception.earlier_pictures import ObjectPosterior
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_prior import PoseDeviation
from grasptransfer.registration import DeformationField

NAMED_RIGHT = 0.95  # share of the pictures that show what they are said to show, as they are said to show it


class EstimateStatus(enum.Enum):
    """Outcome of a shape estimate; `advice` says what to do about it."""

    OK = "ok"
    NOTHING_SEEN = "nothing_seen"
    OUT_OF_CATEGORY = "out_of_category"
    POSE_TURNED = "pose_turned"
    IMPOSSIBLE_SIZE = "impossible_size"
    BOX_MISPLACED = "box_misplaced"
    NOT_CONVERGED = "not_converged"

    @property
    def refused(self) -> bool:
        """Whether the input is so likely wrong that no grasp may be executed."""
        return self not in (EstimateStatus.OK, EstimateStatus.NOT_CONVERGED)

    @property
    def advice(self) -> str:
        """One sentence for the user."""
        return {
            EstimateStatus.OK: "The instance was reconstructed.",
            EstimateStatus.NOTHING_SEEN: "No object is seen where the pose and the box say: check picture, "
            "pose, camera and box.",
            EstimateStatus.OUT_OF_CATEGORY: "This does not look like the category: check category and pose.",
            EstimateStatus.POSE_TURNED: "The picture contradicts the given pose: check the axes of "
            "object and camera.",
            EstimateStatus.IMPOSSIBLE_SIZE: "No object of the category is as large or small: check the "
            "pose's distance, its unit, and the camera's focal length.",
            EstimateStatus.BOX_MISPLACED: "Box and pose contradict each other, or the picture: check both.",
            EstimateStatus.NOT_CONVERGED: "The fit did not settle: check the pose, or give a mask.",
        }[self]


@dataclass(frozen=True)
class ShapeEstimate:
    """A reconstructed instance.

    Args:
        field: canonical to object frame [m].
        camera_from_object: (4, 4) the pose, refined where the estimator does that.
        latent: (k,) coordinates of `field` in the shape space, standard deviations from the mean.
        covariance: (6 + k, 6 + k) joint posterior of turn about the object's origin [rad] and shift [m],
            camera axes, and `latent`; 0 where a pose was taken as given.
        mask: (h, w) pixels of the object in the first picture: the given mask, or else the predicted one.
        category_score: chance that the picture shows an object of the category as pose, camera and box say,
            had right and wrong inputs been alike likely before, in [0, 1]; None where the estimator does not
            judge it.
        status: outcome.
        warning: what seems to be wrong with the input, one sentence, or None.
        pose_sigma_prior: how sure the given pose was taken to be; None where it was not asked.
        posterior: what the next picture may take for known (`earlier` of its observation); None where the
            estimator keeps nothing.
        timings: seconds per stage.
    """

    field: DeformationField
    camera_from_object: Float[np.ndarray, "4 4"]
    latent: Float[np.ndarray, "k"] | None = None
    covariance: Float[np.ndarray, "s s"] | None = None
    mask: Bool[np.ndarray, "h w"] | None = None
    category_score: float | None = None
    status: EstimateStatus = EstimateStatus.OK
    warning: str | None = None
    pose_sigma_prior: PoseDeviation | None = None
    posterior: ObjectPosterior | None = None
    timings: dict[str, float] = dataclasses.field(default_factory=dict)

    @property
    def advice(self) -> str:
        """What to do, in a sentence or two: of the status, and of the warning."""
        return self.status.advice if self.warning is None else f"{self.status.advice} {self.warning}"

    @property
    def trust(self) -> float:
        """Chance that category, pose and box are right, as they mostly are before the picture is seen.

        0 where the picture was judged and the input refused: no grasp is usable then.
        """
        if self.category_score is None:
            return 1.0
        if self.status.refused:
            return 0.0
        own, stranger = NAMED_RIGHT * self.category_score, (1 - NAMED_RIGHT) * (1 - self.category_score)
        return own / (own + stranger)

    @property
    def pose_sigma_posterior(self) -> PoseDeviation | None:
        """How sure the pose is, the picture seen; 0 where it was taken as given."""
        if self.covariance is None:
            return None
        return PoseDeviation.of(self.camera_from_object, self.covariance[:6, :6])

    @property
    def latent_covariance(self) -> Float[np.ndarray, "k k"] | None:
        """(k, k) posterior covariance of `latent`."""
        return None if self.covariance is None else self.covariance[6:, 6:]


def with_certain_pose(latent_covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "s s"]:
    """The joint covariance of an estimate that takes its pose as given."""
    size = len(latent_covariance)
    covariance = np.zeros((6 + size, 6 + size))
    covariance[6:, 6:] = latent_covariance
    return covariance


Estimator: TypeAlias = Callable[[Observation], ShapeEstimate]
