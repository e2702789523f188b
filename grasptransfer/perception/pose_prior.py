"""What is known of a given pose before the picture is looked at: a prior with heavy tails around it.

Three estimators that read poses from RGB, with the CAD model at hand, err along the ray by 0.5 to 1.1 % of
the distance in the median, across it by 0.4 to 0.5 %, and turn by 2.4 to 3.0 degrees (BOP submissions of
EPOS, GDRNPP and ZebraPose on 27 photographs of one drill, 0.6 to 1.2 m away). A tenth errs two to three
times as much: the prior is a Student t distribution over turn and shift together, as a pose that is far off
across the ray mostly is so along it, too.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import drift

# Standard deviations: shares of the distance along and across the ray, and a turn about each axis.
ALONG_RAY, ACROSS_RAY, TURN = 0.013, 0.0038, np.deg2rad(1.7)
# What no shape of the space expresses looks like a turned or shifted object: cells and outline say so many
# times less of the pose than their residuals do. At 6, E of 27 photographs of a drill with poses of three
# estimators falls from 59, 62 and 67 (at 1) to 51, 51 and 61; that of poses wrong by 5 cm stays as it is.
# Seen from more sides, turn, distance and shape no longer look alike: two pictures 45 degrees apart, which
# count 4/3, leave it at 2.
POSE_OVERCONFIDENCE, TOLD_APART = 6.0, 0.2
FREEDOM = 5.0  # degrees of freedom of Student's distribution
SUREST = 1e-5  # rad, m: a given deviation below this counts as this, so that the covariance has an inverse


@dataclass(frozen=True)
class PosePrior:
    """Student t distribution of a pose about the given one.

    Args:
        camera_from_object: (4, 4) as given.
        covariance: (6, 6) of the normal distribution that it has near its centre, as of `frames.drift`:
            turn [rad] about the object's origin, then shift [m], along camera axes.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    covariance: Float[np.ndarray, "6 6"]

    @classmethod
    def of(
        cls, camera_from_object: Float[np.ndarray, "4 4"], covariance: Float[np.ndarray, "6 6"] | None
    ) -> "PosePrior | None":
        """The prior of a pose with this covariance; None for a pose that is exact.

        Args:
            covariance: as `poses.covariance_of` gives it; None takes that of real estimators.
        """
        if covariance is None:
            return cls(camera_from_object, _of_real_estimators(camera_from_object))
        if not covariance.any():
            return None
        variances, axes = np.linalg.eigh(covariance)
        floored = np.maximum(variances, SUREST**2)
        return cls(camera_from_object, (axes * floored) @ axes.T)

    @cached_property
    def _precision(self) -> Float[np.ndarray, "6 6"]:
        return np.linalg.inv(self.covariance)

    @property
    def deviation(self) -> "PoseDeviation":
        """Along the ray, across it, and of the turn."""
        return PoseDeviation.of(self.camera_from_object, self.covariance)

    def quadratic(
        self, pose: Float[np.ndarray, "4 4"], *, surer: float = 1.0
    ) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
        """Hessian and gradient of the negative log prior at a pose; the farther, the weaker its hold.

        Args:
            surer: factor by which the prior's variances are divided.
        """
        off = drift(self.camera_from_object, pose)
        precision = surer * self._precision
        hold = precision * (FREEDOM + len(off)) / (FREEDOM + off @ precision @ off)
        return hold, hold @ off


def pose_overconfidence(pictures: float) -> float:
    """How many times less pictures say of the pose than their residuals do.

    Args:
        pictures: sum of the weights of all that see the pose.
    """
    return 1 + (POSE_OVERCONFIDENCE - 1) * float(np.exp(-max(pictures - 1, 0.0) / TOLD_APART))


@dataclass(frozen=True)
class PoseDeviation:
    """Standard deviations of a pose.

    Args:
        along_ray: deviation of the object's origin along its ray [m].
        across_ray: deviation of the object's origin along each axis across its ray [m].
        turn: deviation about each axis [deg].
    """

    along_ray: float
    across_ray: float
    turn: float

    @classmethod
    def of(
        cls, camera_from_object: Float[np.ndarray, "4 4"], covariance: Float[np.ndarray, "6 6"]
    ) -> "PoseDeviation":
        """Of a covariance over turn [rad] and shift [m], camera axes."""
        ray = _ray(camera_from_object)
        along = float(ray @ covariance[3:, 3:] @ ray)
        across = (float(np.trace(covariance[3:, 3:])) - along) / 2
        turn = float(np.trace(covariance[:3, :3])) / 3
        return cls(
            float(np.sqrt(max(along, 0.0))),
            float(np.sqrt(max(across, 0.0))),
            float(np.rad2deg(np.sqrt(max(turn, 0.0)))),
        )


def _of_real_estimators(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6 6"]:
    distance, ray = float(np.linalg.norm(camera_from_object[:3, 3])), _ray(camera_from_object)
    along = np.outer(ray, ray)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = TURN**2 * np.eye(3)
    covariance[3:, 3:] = distance**2 * (ALONG_RAY**2 * along + ACROSS_RAY**2 * (np.eye(3) - along))
    return covariance


def _ray(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    return camera_from_object[:3, 3] / np.linalg.norm(camera_from_object[:3, 3])
