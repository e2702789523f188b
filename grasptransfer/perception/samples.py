"""One training sample: an instance in front of nothing, the canonical at the told pose, and the true motion.

Backgrounds, occluders and the camera's faults are added while training (`augmentation.py`),
so each rendered sample serves many times and never looks the same twice.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float16, Float32, Int, UInt8

from grasptransfer.camera import Camera
from grasptransfer.frames import invert, transform_points
from grasptransfer.perception.canonical_view import cell_centres, view_canonical
from grasptransfer.perception.networks import FLOW_UNIT, OFFSET_UNIT
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.scenes import (
    TRAINING_NOISE_SHARES,
    TRAINING_NOISES,
    PoseNoise,
    draw_camera,
    draw_lighting,
    draw_pose,
    towards,
)
from grasptransfer.perception.zoom import Box, enlarge, projected_box, union, zoom_box, zoom_camera

NO_BOX_MARGIN = 1.3  # without a detection the canonical's own box, this much larger, is searched


@dataclass(frozen=True)
class TrainingShape:
    """An instance with its known motion from the canonical model.

    Args:
        scene: the textured instance, object frame, metres.
        vertices: (v, 3) of its surface, object frame [m].
        move: canonical points (m, 3) and the face of each -> points on the instance (m, 3), valid (m,).
    """

    scene: trimesh.Scene | trimesh.Trimesh
    vertices: Float[np.ndarray, "v 3"]
    move: Callable[[Float[np.ndarray, "m 3"], Int[np.ndarray, "m"]], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Sample:
    """What the network is trained on; sizes are those of the zoom and of the cells."""

    observed: UInt8[np.ndarray, "192 256 5"]  # RGB over black, alpha, silhouette
    canonical: UInt8[np.ndarray, "192 256 3"]
    box: Float32[np.ndarray, "4"]  # told box of the object in the zoomed picture [px]; NaN: none told
    offset: Float16[np.ndarray, "24 32 3"]  # view axes [OFFSET_UNIT]
    flow: Float16[np.ndarray, "24 32 2"]  # [FLOW_UNIT]
    valid: Bool[np.ndarray, "24 32"]


def render_sample(
    shape: TrainingShape,
    canonical: trimesh.Trimesh,
    rng: np.random.Generator,
    *,
    renderer: Renderer,
    noise: PoseNoise | None = None,
) -> Sample | None:
    """Render one sample from a random view; None where the canonical falls outside the zoom.

    Args:
        canonical: geometry whose faces `shape.move` knows, canonical frame [m].
        noise: error of the told pose; None draws one of the training mixture.
    """
    camera = draw_camera(rng)
    radius = float(np.linalg.norm(shape.vertices, axis=1).max())
    true_pose = draw_pose(camera, radius, rng)
    noise = noise or TRAINING_NOISES[rng.choice(len(TRAINING_NOISES), p=TRAINING_NOISE_SHARES)]
    told_pose = noise.apply(true_pose, rng)
    box, crop = _draw_boxes(shape, canonical, camera, true_pose, told_pose, rng)
    zoomed = zoom_camera(camera, crop)
    picture = renderer.render(shape.scene, zoomed, true_pose, lighting=draw_lighting(rng))
    view = view_canonical(canonical, zoomed, told_pose, renderer=renderer)
    offset, flow, valid = true_motion(shape, canonical, zoomed, true_pose=true_pose, told_pose=told_pose)
    valid &= view.cell_mask
    if not valid.any() or not picture.mask.any():
        return None
    alpha = np.round(picture.alpha * 255).astype(np.uint8)[..., None]
    silhouette = picture.mask[..., None].astype(np.uint8) * 255
    observed = np.concatenate([picture.rgb, alpha, silhouette], -1)
    return Sample(observed, view.coordinates, box, offset, flow, valid)


def true_motion(
    shape: TrainingShape, canonical: trimesh.Trimesh, zoomed: Camera, *, true_pose, told_pose
) -> tuple[Float16[np.ndarray, "24 32 3"], Float16[np.ndarray, "24 32 2"], Bool[np.ndarray, "24 32"]]:
    """Offsets, flow and their validity at the network's cells, from exact correspondences."""
    rows, columns = cell_centres(zoomed)
    pixels = np.stack(np.meshgrid(columns, rows), -1).astype(float)
    object_from_camera = invert(told_pose)
    rays = zoomed.unproject(pixels, np.ones(pixels.shape[:2])) @ object_from_camera[:3, :3].T
    origins = np.broadcast_to(object_from_camera[:3, 3], (rays.size // 3, 3))
    points, ray, face = canonical.ray.intersects_location(origins, rays.reshape(-1, 3), multiple_hits=False)
    faces = canonical.ray.intersects_first(origins[ray], rays.reshape(-1, 3)[ray]) if face is None else face
    moved, known = shape.move(points, faces)
    seen = zoomed.project(transform_points(true_pose, moved))
    cells = np.unravel_index(ray, pixels.shape[:2])
    offset, flow = np.zeros((*pixels.shape[:2], 3), np.float16), np.zeros((*pixels.shape[:2], 2), np.float16)
    valid = np.zeros(pixels.shape[:2], bool)
    offset[cells] = (moved - points) @ view_from_object(told_pose).T / OFFSET_UNIT
    flow[cells] = (seen - pixels[cells]) / FLOW_UNIT
    valid[cells] = known
    return offset, flow, valid


def view_from_object(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation from object axes to view axes: z along the ray to the object's origin, x right, y down.

    In view axes an offset's first two components are what moves in the picture, wherever in it the
    object is: far easier to learn than object axes, and the told pose turns them back exactly.
    """
    return towards(camera_from_object[:3, 3]).T @ camera_from_object[:3, :3]


def _draw_boxes(shape, canonical, camera, true_pose, told_pose, rng) -> tuple[Float32[np.ndarray, "4"], Box]:
    """The told box (in zoomed pixels; sometimes loose, sometimes none) and the zoom's box."""
    canonical_box = projected_box(canonical.vertices, camera, told_pose)
    if rng.random() < 0.25:
        crop = zoom_box(enlarge(canonical_box, NO_BOX_MARGIN))
        return np.full(4, np.nan, np.float32), crop
    u0, v0, u1, v1 = projected_box(shape.vertices, camera, true_pose)
    width, height = u1 - u0, v1 - v0
    shift = rng.normal(0, rng.choice([0.005, 0.03]), 4) * [width, height, width, height]
    box = (u0 + shift[0], v0 + shift[1], u1 + shift[2], v1 + shift[3])
    crop = zoom_box(union(canonical_box, box))
    scale = 256 / (crop[2] - crop[0])
    told = (np.array(box) - [crop[0], crop[1], crop[0], crop[1]]) * scale - 0.5
    return told.astype(np.float32), crop
