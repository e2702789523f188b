"""Joint refinement of pose and latent by Gauss-Newton on predicted flow and offsets.

Unknowns are a turn about the object's origin, a shift (camera frame) and the latent. Their
residuals: where each canonical point, displaced by the shape and placed by the pose, is seen
(flow), how far it was displaced (offsets), and the priors. The paper fits the latent alone to
offsets alone (eq. 13); flow says more where the shape is seen, and tells pose from shape.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.frames import moved
from grasptransfer.perception.pose_prior import PosePrior
from grasptransfer.perception.silhouette import Meetings, Silhouette
from grasptransfer.registration import DisplacementModel, motion_along

# Neighbouring cells err together, and much of what they say the latent prior from the same picture has
# said already, above all of depth: all cells count as much as this many independent ones.
INDEPENDENT_FLOWS, INDEPENDENT_OFFSETS = 3.0, 0.3
# What no shape of the space expresses looks like a turned or shifted object: cells and outline say so many
# times less of the pose than their residuals do. At 6, E of 27 photographs of a drill with poses of three
# estimators falls from 59, 62 and 67 (at 1) to 51, 51 and 61; that of poses wrong by 5 cm stays as it is.
POSE_OVERCONFIDENCE = 6.0
ITERATIONS = 24
CONVERGED = 5e-2  # of a standard deviation: far below what grasps notice
LONGEST_STEP = (0.2, 0.05, 2.0)  # rad, m, standard deviations: beyond, a linear model says nothing
# When the vertices on the outline are searched: once flow and offsets have brought it near, and then
# again; after that they stay, or the fit would jump between neighbouring vertices for ever.
OUTLINE_SEARCHES = (3, 6, 9)


@dataclass(frozen=True)
class LatentPrior:
    """What is known of the latent before its visible motion is fitted: independent normal errors.

    Args:
        mean: (k,).
        deviation: (k,) standard deviations.
    """

    mean: Float[np.ndarray, "k"]
    deviation: Float[np.ndarray, "k"]


@dataclass(frozen=True)
class Motion:
    """What the network says of the visible canonical points.

    Args:
        offsets: (c, 3) displacement, object axes [m].
        offset_scale: (c,) Laplace scale of their errors [m].
        pixels: (c, 2) where the displaced points are seen in the zoomed picture [px].
        pixel_scale: (c,) Laplace scale of their errors [px].
    """

    offsets: Float[np.ndarray, "c 3"]
    offset_scale: Float[np.ndarray, "c"]
    pixels: Float[np.ndarray, "c 2"]
    pixel_scale: Float[np.ndarray, "c"]


@dataclass(frozen=True)
class Outline:
    """The model's surface, and the mask that its outline must meet.

    Args:
        points: (v, 3) canonical surface points [m].
        model: of their displacement by the latent, `ShapeSpace.displacement_model(points)`.
    """

    silhouette: Silhouette
    points: Float[np.ndarray, "v 3"]
    model: DisplacementModel

    def shaped(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """The surface points of the shape with this latent, object frame [m]."""
        return self.model.displaced(self.points, latent)


@dataclass(frozen=True)
class PoseAndShape:
    """Result: refined pose, latent and their joint posterior covariance.

    Args:
        covariance: (6 + k, 6 + k) over turn [rad], shift [m] and latent; 0 for a pose that was kept.
        converged: whether the latent's last step was small; the pose's is, by then, some 0.2 degrees and mm.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    latent: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "s s"]
    converged: bool


def fit_pose_and_shape(
    motion: Motion,
    points: Float[np.ndarray, "c 3"],
    model: DisplacementModel,
    *,
    camera: Camera,
    start_pose: Float[np.ndarray, "4 4"],
    pose_prior: PosePrior | None,
    latent_prior: LatentPrior | None = None,
    outline: Outline | None = None,
) -> PoseAndShape:
    """Maximise the posterior of pose and latent.

    Args:
        points: (c, 3) canonical points of the cells [m].
        model: of their displacement by the latent, `ShapeSpace.displacement_model(points)`.
        camera: of the zoomed picture.
        start_pose: `camera_from_object` to start from.
        pose_prior: of the pose about the given one; None trusts the start pose and fits the latent alone.
        latent_prior: None takes the shape space's own, zero mean and unit deviation.
        outline: the predicted mask, and the model's surface whose outline must meet it.
    """
    size = model.n_modes
    latent_prior = latent_prior or LatentPrior(np.zeros(size), np.ones(size))
    evidence = _Evidence(motion, points, model, camera, outline)
    prior = _Prior(pose_prior, latent_prior)
    pose, latent = start_pose, latent_prior.mean
    free = slice(0, None) if pose_prior is not None else slice(6, None)
    longest = np.concatenate([np.repeat(LONGEST_STEP[:2], 3), np.full(size, LONGEST_STEP[2])])
    covariance, converged = np.zeros((6 + size, 6 + size)), False
    for iteration in range(ITERATIONS):
        if iteration in OUTLINE_SEARCHES:
            evidence.search_outline(pose, latent)
        hessian, gradient = evidence.quadratic(pose, latent)
        hold, pull = prior.quadratic(pose, latent)
        covariance[free, free] = np.linalg.inv((hessian + hold)[free, free])
        step = np.zeros(6 + size)
        step[free] = -covariance[free, free] @ (gradient + pull)[free]
        step *= min(1.0, 1 / max(np.abs(step / longest).max(), 1e-9))
        pose = moved(pose, step[:6])
        latent = latent + step[6:]
        converged = bool(np.abs(step[6:]).max() < CONVERGED)
        if converged and (outline is None or iteration > OUTLINE_SEARCHES[-1]):
            break
    return PoseAndShape(pose, latent, _widened(covariance), converged)


def _widened(covariance: Float[np.ndarray, "s s"]) -> Float[np.ndarray, "s s"]:
    """With the pose as unsure as what the picture really says of it leaves it."""
    deviation = np.ones(len(covariance))
    deviation[:6] = np.sqrt(POSE_OVERCONFIDENCE)
    return covariance * np.outer(deviation, deviation)


@dataclass
class _Evidence:
    """What the picture says, as hessian and gradient over turn, shift and latent."""

    motion: Motion
    points: Float[np.ndarray, "c 3"]
    model: DisplacementModel
    camera: Camera
    outline: Outline | None
    meetings: Meetings | None = None  # of outline and mask, once searched

    def search_outline(self, pose, latent):
        """Find the vertices that lie on the model's outline now."""
        if self.outline is not None and self.outline.silhouette.usable:
            self.meetings = self.outline.silhouette.meetings(self.outline.shaped(latent), pose)

    def quadratic(self, pose, latent) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s"]]:
        """Of flow, offsets and outline together."""
        shaped = self.model.displaced(self.points, latent)
        terms = [
            _offset_terms(self.motion, self.model, latent),
            _flow_terms(self.motion, shaped, self.model.basis, self.camera, pose),
        ]
        if self.outline is not None and self.meetings is not None:
            terms.append(_outline_terms(self.outline, self.meetings, latent, pose))
        hessians, gradients = zip(*terms, strict=True)
        return np.sum(hessians, axis=0), np.sum(gradients, axis=0)


@dataclass(frozen=True)
class _Prior:
    """What is known of the pose, and of the latent."""

    pose: PosePrior | None
    latent: LatentPrior

    def quadratic(self, pose, latent) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s"]]:
        """Hessian and gradient."""
        precision = self.latent.deviation**-2
        hold = np.diag(np.concatenate([np.zeros(6), precision]))
        pull = np.concatenate([np.zeros(6), precision * (latent - self.latent.mean)])
        if self.pose is not None:
            # Latents weigh as before: the given pose holds the more, in place of evidence that says the less.
            hold[:6, :6], pull[:6] = self.pose.quadratic(pose, surer=POSE_OVERCONFIDENCE)
        return hold, pull


def _offset_terms(motion: Motion, model: DisplacementModel, latent):
    """Hessian and gradient of the offset residuals; the pose does not enter."""
    size, basis = model.n_modes, model.basis
    residual = model.at(latent) - motion.offsets
    weight = _laplace_weight(residual, motion.offset_scale, INDEPENDENT_OFFSETS)
    rows = basis * weight[:, None, None]
    hessian, gradient = np.zeros((6 + size, 6 + size)), np.zeros(6 + size)
    rows, by_latent = rows.reshape(-1, size), basis.reshape(-1, size)
    hessian[6:, 6:] = rows.T @ by_latent
    gradient[6:] = rows.T @ residual.ravel()
    return hessian, gradient


def _flow_terms(motion: Motion, shaped, basis, camera: Camera, pose):
    """Hessian and gradient of the flow residuals over turn, shift and latent."""
    turned = shaped @ pose[:3, :3].T
    seen = turned + pose[:3, 3]
    residual = camera.project(seen) - motion.pixels
    weight = _laplace_weight(residual, motion.pixel_scale, INDEPENDENT_FLOWS)
    hessian, gradient = 0.0, 0.0
    for axis in range(2):
        jacobian = motion_along(_pixel_gradient(seen, camera)[:, axis], turned, basis, pose[:3, :3])
        rows = jacobian * weight[:, None]
        hessian, gradient = hessian + rows.T @ jacobian, gradient + rows.T @ residual[:, axis]
    return hessian, gradient


def _outline_terms(outline: Outline, meetings: Meetings, latent, pose):
    """Hessian and gradient of the distances between outline and mask's border."""
    camera, model = outline.silhouette.camera, outline.model.take(meetings.vertices)
    turned = model.displaced(outline.points[meetings.vertices], latent) @ pose[:3, :3].T
    seen = turned + pose[:3, 3]
    distance, slope, weight = meetings.residuals(camera.project(seen))
    directions = np.einsum("pd,pdi->pi", slope, _pixel_gradient(seen, camera))
    jacobian = motion_along(directions, turned, model.basis, pose[:3, :3])
    rows = jacobian * weight[:, None]
    return rows.T @ jacobian, rows.T @ distance


def _pixel_gradient(seen: Float[np.ndarray, "p 3"], camera: Camera) -> Float[np.ndarray, "p 2 3"]:
    """Derivative of the pixels by the points, camera frame [px/m]."""
    gradient = np.zeros((len(seen), 2, 3))
    gradient[:, 0, 0], gradient[:, 1, 1] = camera.fx / seen[:, 2], camera.fy / seen[:, 2]
    gradient[:, 0, 2] = -camera.fx * seen[:, 0] / seen[:, 2] ** 2
    gradient[:, 1, 2] = -camera.fy * seen[:, 1] / seen[:, 2] ** 2
    return gradient


def _laplace_weight(
    residual: Float[np.ndarray, "c d"], scale: Float[np.ndarray, "c"], independent: float
) -> Float[np.ndarray, "c"]:
    """Weights with which least squares fits Laplace errors, of few independent cells."""
    length = np.linalg.norm(residual, axis=1)
    share = min(1.0, independent / max(len(length), 1))
    return share / (scale * np.sqrt(length**2 + scale**2))
