"""One training sample: a picture of an instance, the assumed model at the given pose, and their difference.

Backgrounds, occluders and the camera's faults are added during training (`augmentation.py`), so that each
rendered sample serves many times and is never the same twice.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float16, Float32, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import Box, projected_box
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.frames import transform_points
from grasptransfer.perception.canonical_view import CanonicalView, view_canonical
from grasptransfer.perception.network_input import view_from_object, zoom_for
from grasptransfer.perception.networks import FLOW_UNIT, LATENT_SIZE, OFFSET_UNIT
from grasptransfer.perception.zoom import centre_on_box, zoom_camera
from grasptransfer.workshop.training.scenes import (
    TRAINING_NOISE_SHARES,
    TRAINING_NOISES,
    WIDE_NOISE,
    PoseNoise,
    draw_camera,
    draw_lighting,
    draw_pose,
)
from grasptransfer.workshop.training.training_shapes import TrainingCanonical, TrainingShape


@dataclass(frozen=True)
class Sample:
    """What the network is trained on; sizes are those of the zoom and of the cells."""

    observed: UInt8[np.ndarray, "192 256 5"]  # RGB over black, alpha, silhouette
    canonical: UInt8[np.ndarray, "192 256 3"]
    box: Float32[np.ndarray, "4"]  # The object's given box in the zoomed picture [px]; NaN without one.
    offset: Float16[np.ndarray, "24 32 3"]  # view axes [OFFSET_UNIT]
    flow: Float16[np.ndarray, "24 32 2"]  # [FLOW_UNIT]
    valid: Bool[np.ndarray, "24 32"]
    latent: Float32[np.ndarray, "40"]  # true minus assumed
    mode_size: Float32[np.ndarray, "40"]  # of each mode [OFFSET_UNIT]; 0 beyond the category's modes
    category: UInt8[np.ndarray, ""]  # its number among those trained together


def render_sample(
    shape: TrainingShape,
    canonical: TrainingCanonical,
    rng: np.random.Generator,
    *,
    renderer: Renderer,
    noise: PoseNoise | None = None,
    category: int = 0,
) -> Sample | None:
    """Render one sample from a random view; None where the canonical falls outside the zoom.

    Args:
        noise: error of the given pose; None draws one from the training mixture.
        category: number of the shape's category among those trained together.
    """
    camera = draw_camera(rng)
    radius = float(np.linalg.norm(shape.vertices, axis=1).max())
    true_pose = draw_pose(camera, radius, rng)
    noise = noise or TRAINING_NOISES[rng.choice(len(TRAINING_NOISES), p=TRAINING_NOISE_SHARES)]
    assumed = _draw_assumed(shape.latent, rng)
    vertices = canonical.vertices(assumed)
    box = _draw_box(projected_box(shape.vertices, camera, true_pose), rng)
    given_pose = noise.apply(true_pose, rng)
    if box is not None and noise is WIDE_NOISE:
        given_pose = centre_on_box(vertices, camera, given_pose, box)
    elif noise is WIDE_NOISE:
        given_pose = true_pose
    crop, given_box = zoom_for(projected_box(vertices, camera, given_pose), box)
    zoomed = zoom_camera(camera, crop)
    picture = renderer.render(shape.scene, zoomed, true_pose, lighting=draw_lighting(rng))
    view = view_canonical(canonical.mesh, zoomed, given_pose, vertices=vertices)
    offset, flow, valid = true_motion(shape, view, zoomed, true_pose=true_pose, given_pose=given_pose)
    if not valid.any() or not picture.mask.any():
        return None
    alpha = np.round(picture.alpha * 255).astype(np.uint8)[..., None]
    silhouette = picture.mask[..., None].astype(np.uint8) * 255
    observed = np.concatenate([picture.rgb, alpha, silhouette], -1)
    latent, mode_size = np.zeros(LATENT_SIZE, np.float32), np.zeros(LATENT_SIZE, np.float32)
    latent[: canonical.n_modes] = shape.latent - assumed
    mode_size[: canonical.n_modes] = canonical.mode_size / OFFSET_UNIT
    number = np.array(category, np.uint8)
    return Sample(observed, view.coordinates, given_box, offset, flow, valid, latent, mode_size, number)


def true_motion(
    shape: TrainingShape, view: CanonicalView, zoomed: Camera, *, true_pose, given_pose
) -> tuple[Float16[np.ndarray, "24 32 3"], Float16[np.ndarray, "24 32 2"], Bool[np.ndarray, "24 32"]]:
    """Offsets, flow and their validity at the network's cells, from exact correspondences.

    Args:
        shape: the instance and its motion from the canonical model.
        view: the assumed model as seen at the given pose.
        zoomed: camera of the zoomed picture.
        true_pose, given_pose: (4, 4) `camera_from_object` [m].
    """
    moved, known = shape.move(view.cell_points, view.cell_faces)
    seen = zoomed.project(transform_points(true_pose, moved))
    cells, size = view.cell_mask, view.cell_mask.shape
    offset, flow = np.zeros((*size, 3), np.float16), np.zeros((*size, 2), np.float16)
    valid = np.zeros(size, bool)
    offset[cells] = (moved - view.cell_places) @ view_from_object(given_pose).T / OFFSET_UNIT
    flow[cells] = (seen - view.cell_pixels) / FLOW_UNIT
    valid[cells] = known
    return offset, flow, valid


def _draw_assumed(latent: Float[np.ndarray, "k"], rng: np.random.Generator) -> Float[np.ndarray, "k"]:
    """The assumed latent: zero, or an earlier estimate of it.

    An estimate whose error has standard deviation s is drawn towards the prior mean as a posterior mean is,
    so that the expected truth, given the estimate, is the estimate itself.
    """
    if rng.random() < 0.5:
        return np.zeros(len(latent))
    error = rng.uniform(0.15, 0.9)
    keep = 1 - error**2
    return keep * latent + error * np.sqrt(keep) * rng.normal(size=len(latent))


def _draw_box(true_box: Box, rng: np.random.Generator) -> Box | None:
    """The box that a detector would give: sometimes a loose one, sometimes none."""
    if rng.random() < 0.25:
        return None
    u0, v0, u1, v1 = true_box
    width, height = u1 - u0, v1 - v0
    shift = rng.normal(0, rng.choice([0.005, 0.03]), 4) * [width, height, width, height]
    return u0 + shift[0], v0 + shift[1], u1 + shift[2], v1 + shift[3]
