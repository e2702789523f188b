"""What one picture says of pose and shape, as residuals for Gauss-Newton.

Three kinds: where each canonical point, displaced by the shape and placed by the pose, is seen (flow), how
far it was displaced (offsets), and where the model's outline meets the mask's border. Each gives a hessian
and a gradient over a turn about the object's origin, a shift (camera frame) and the latent.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.perception.silhouette import Meetings, Silhouette
from grasptransfer.registration import DisplacementModel, motion_along

# Neighbouring cells err together, and much of what they say the latent prior from the same picture has
# said already, above all of depth: all cells count as much as this many independent ones.
INDEPENDENT_FLOWS, INDEPENDENT_OFFSETS = 3.0, 0.3

Quadratic = tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s"]]  # hessian and gradient


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
        model: their displacement by the latent, `ShapeSpace.displacement_model(points)`.
    """

    silhouette: Silhouette
    points: Float[np.ndarray, "v 3"]
    model: DisplacementModel

    def shaped(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """The surface points of the shape with this latent, object frame [m]."""
        return self.model.displaced(self.points, latent)


@dataclass
class PictureEvidence:
    """What one picture says of its pose and of the latent.

    Args:
        motion: motion of the visible canonical points.
        points: (c, 3) canonical points of the cells [m].
        model: their displacement by the latent, `ShapeSpace.displacement_model(points)`.
        camera: camera of the zoomed picture.
        outline: the predicted mask, and the model's surface whose outline must meet it.
        latent: what the picture as a whole says of the latent.
    """

    motion: Motion
    points: Float[np.ndarray, "c 3"]
    model: DisplacementModel
    camera: Camera
    outline: Outline | None = None
    latent: LatentPrior | None = None
    # Of outline and mask, once searched: the vertices that meet, their points and how the latent moves them.
    _met: tuple[Meetings, Float[np.ndarray, "b 3"], DisplacementModel] | None = None

    def search_outline(self, pose: Float[np.ndarray, "4 4"], latent: Float[np.ndarray, "k"]) -> None:
        """Find the vertices that lie on the model's outline now."""
        if self.outline is not None and self.outline.silhouette.usable:
            outline = self.outline
            meetings = outline.silhouette.meetings(outline.shaped(latent), pose)
            vertices = meetings.vertices
            self._met = (meetings, outline.points[vertices], outline.model.take(vertices))

    def quadratic(self, pose: Float[np.ndarray, "4 4"], latent: Float[np.ndarray, "k"]) -> Quadratic:
        """Of flow, offsets and outline together."""
        shaped = self.model.displaced(self.points, latent)
        terms = [
            _offset_terms(self.motion, self.model, latent),
            _flow_terms(self.motion, shaped, self.model.basis, self.camera, pose),
        ]
        if self._met is not None:
            terms.append(_outline_terms(*self._met, latent, pose))
        hessians, gradients = zip(*terms, strict=True)
        return np.sum(hessians, axis=0), np.sum(gradients, axis=0)


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


def _outline_terms(meetings: Meetings, points, model: DisplacementModel, latent, pose):
    """Hessian and gradient of the distances between outline and mask's border."""
    camera = meetings.silhouette.camera
    turned = model.displaced(points, latent) @ pose[:3, :3].T
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
