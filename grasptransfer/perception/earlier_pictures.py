"""What earlier pictures have left known of an object: the prior of the next one."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import drift, invert


@dataclass(frozen=True)
class ObjectPosterior:
    """A normal distribution of pose and latent.

    Args:
        camera_from_object: (4, 4) its mean pose.
        latent: (k,) its mean latent.
        covariance: (6 + k, 6 + k) over turn about the object's origin [rad] and shift [m], camera axes, and
            latent, as a fit gives it: the latent's is not yet widened to what holds.
        seen_from: (a, 3) directions from the object to the cameras that saw it, object axes.
        given: (4, 4) the given pose in the last picture.
        pose_known: False: nothing is known of the pose in the next picture.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    latent: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "s s"]
    seen_from: Float[np.ndarray, "a 3"]
    given: Float[np.ndarray, "4 4"]
    pose_known: bool = True

    def carried(
        self, given: Float[np.ndarray, "4 4"], noise: Float[np.ndarray, "6 6"], *, pose_known: bool
    ) -> "ObjectPosterior":
        """What it says of the next picture, along the axes of that picture's camera.

        Args:
            given: (4, 4) the given pose in the next picture [m].
            noise: (6, 6) covariance of what may have happened to the pose besides, turn, then shift.
            pose_known: whether the given poses say how the camera moved; else only the latent is carried on.
        """
        moved_camera = given @ invert(self.given)
        turned = np.eye(len(self.covariance))
        turned[:3, :3] = turned[3:6, 3:6] = moved_camera[:3, :3]
        covariance = turned @ self.covariance @ turned.T
        covariance[:6, :6] += noise
        pose = moved_camera @ self.camera_from_object if pose_known else given
        return replace(
            self, camera_from_object=pose, covariance=covariance, given=given, pose_known=pose_known
        )

    def quadratic(
        self, pose: Float[np.ndarray, "4 4"], latent: Float[np.ndarray, "k"], *, surer: float = 1.0
    ) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s"]]:
        """Hessian and gradient of the negative logarithm of its density.

        Args:
            surer: factor by which the pose's variances are divided.
        """
        off = np.concatenate([drift(self.camera_from_object, pose), latent - self.latent])
        precision = np.zeros_like(self.covariance)
        if self.pose_known:
            precision = np.linalg.inv(pose_scaled(self.covariance, 1 / surer))
        else:
            precision[6:, 6:] = np.linalg.inv(self.covariance[6:, 6:])
        return precision, precision @ off


def pose_scaled(covariance: Float[np.ndarray, "s s"], factor: float) -> Float[np.ndarray, "s s"]:
    """A joint covariance over turn, shift and latent whose pose's variances are multiplied by a factor."""
    deviation = np.ones(len(covariance))
    deviation[:6] = np.sqrt(factor)
    return covariance * np.outer(deviation, deviation)


def with_latent_covariance(
    covariance: Float[np.ndarray, "s s"], latent: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, "s s"]:
    """A joint covariance over turn, shift and latent whose latent's part is replaced.

    How the pose goes with the latent (distance with size) stays, and so does its own uncertainty.
    """
    before = covariance[6:, 6:]
    pose_by_latent = np.linalg.solve(before, covariance[6:, :6]).T
    joint = np.empty_like(covariance)
    joint[6:, 6:] = latent
    joint[:6, 6:] = pose_by_latent @ latent
    joint[6:, :6] = joint[:6, 6:].T
    joint[:6, :6] = covariance[:6, :6] + pose_by_latent @ (latent - before) @ pose_by_latent.T
    return joint
