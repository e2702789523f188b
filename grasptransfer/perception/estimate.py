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

NAMED_RIGHT = 0.95  # share of the pictures that show the category they are said to show


class EstimateStatus(enum.Enum):
    """Outcome of a shape estimate; `advice` says what to do about it."""

    OK = "ok"
    OUT_OF_CATEGORY = "out_of_category"
    NOT_CONVERGED = "not_converged"

    @property
    def advice(self) -> str:
        """One sentence for the user."""
        return {
            EstimateStatus.OK: "The instance was reconstructed.",
            EstimateStatus.OUT_OF_CATEGORY: "This does not look like the category: check category and pose.",
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
        category_score: chance that the object is of the category, had own objects and strangers been alike
            likely before, in [0, 1]; None where the estimator does not judge it.
        status: outcome.
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
    pose_sigma_prior: PoseDeviation | None = None
    posterior: ObjectPosterior | None = None
    timings: dict[str, float] = dataclasses.field(default_factory=dict)

    @property
    def trust(self) -> float:
        """Chance that the object is of the named category: that is mostly right, before one looks."""
        if self.category_score is None:
            return 1.0
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
