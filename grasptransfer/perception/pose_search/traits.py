"""What speaks for a view of the grid, and for a pose that was fitted from one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.boxes import Box, overlap, projected_box
from grasptransfer.drawing.visible import visible_faces
from grasptransfer.perception.canonical_view import CanonicalView, view_canonical
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.look import Look
from grasptransfer.perception.network_input import network_input, zoom_for
from grasptransfer.perception.networks import FLOW_UNIT, Prediction
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_search.grid import misfit
from grasptransfer.perception.pose_search.one_member import OneMember
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.signs import OF_PASS, overlap_of
from grasptransfer.perception.zoom import MASK_STRIDE, zoom_camera, zoom_picture

VIEW_TRAITS = ("match", "latent", "flow", "flow_scale", "offset_scale", "overlap", "misfit")
POSE_TRAITS = ("view", "match", "latent", "flow", "flow_scale", "offset_scale", "overlap", "box_overlap")


@dataclass(frozen=True)
class SeenBox:
    """A picture zoomed on a box, as every view of the grid is compared with it."""

    observation: Observation
    box: Box

    @property
    def zoomed(self) -> tuple[np.ndarray, np.ndarray, Camera]:
        """The picture, the box in it, and its camera."""
        crop, given = zoom_for(self.box, self.box)
        return zoom_picture(self.observation.image, crop), given, zoom_camera(self.observation.camera, crop)


def view_traits(
    network: OneMember, category: Category, seen: SeenBox, poses: Float[np.ndarray, "c 4 4"]
) -> Float[np.ndarray, "c t"]:
    """What one network of the ensemble says of the mean model at each pose; in the order of `VIEW_TRAITS`.

    All views share the zoom, so that the features of the picture are made once.
    """
    picture, given, camera = seen.zoomed
    points, count = np.asarray(category.canonical.vertices), len(poses)
    views = [view_canonical(category.canonical, camera, pose) for pose in poses]
    coordinates = np.stack([view.coordinates for view in views])
    repeated = np.broadcast_to(picture, (count, *picture.shape)), np.broadcast_to(given, (count, 4))
    prediction = network(network_input(*repeated, coordinates), same_picture=True)
    traits = [_of_view(prediction, index, view) for index, view in enumerate(views)]
    shapes = [misfit(points, seen.observation.camera, pose, seen.box) for pose in poses]
    return np.column_stack([traits, shapes])


def _of_view(prediction: Prediction, index: int, view: CanonicalView) -> list[float]:
    cells = view.cell_mask
    if not cells.any():
        return [-9.0, 3.0, 60.0, 3.0, 3.0, 0.0]  # as bad as any view that is seen
    match, latent = prediction.match_logit, prediction.latent
    silhouette = np.any(view.coordinates, axis=-1)[2::MASK_STRIDE, 2::MASK_STRIDE]
    return [
        0.0 if match is None else float(match[index]),
        0.0 if latent is None else float(np.sqrt(np.mean(latent[index] ** 2))),
        float(np.linalg.norm(prediction.flow[index][:, cells], axis=0).mean()) * FLOW_UNIT,
        float(prediction.flow_log_scale[index, 0][cells].mean()),
        float(prediction.offset_log_scale[index, 0][cells].mean()),
        overlap_of(silhouette, prediction.mask_logit[index, 0] > 0),
    ]


def pose_traits(
    estimator: RgbEstimator, seen: SeenBox, estimate: ShapeEstimate, view: float
) -> Float[np.ndarray, "t"]:
    """What one more pass says of a fitted pose and shape; in the order of `POSE_TRAITS`.

    Args:
        view: logarithm of the chance of the view that the fit began with.

    Raises:
        PoseError: the fit has lost the object.
    """
    pose, latent = estimate.camera_from_object, estimate.latent
    assert latent is not None
    look = estimator.look(seen.observation, pose, latent)
    vertices = estimator.category.vertices_by_latent.displaced(
        np.asarray(estimator.category.canonical.vertices), latent
    )
    box = projected_box(vertices, seen.observation.camera, pose)
    motion = look.motion
    return np.array([
        view,
        look.signs[OF_PASS.index("match")],
        np.sqrt(np.mean(latent**2)),
        np.linalg.norm(motion.pixels - look.view.cell_pixels, axis=1).mean(),
        np.log(motion.pixel_scale).mean(),
        np.log(motion.offset_scale).mean(),
        _shown_overlap(estimator, vertices, pose, look),
        overlap(box, seen.box),
    ])  # fmt: skip


def _shown_overlap(estimator: RgbEstimator, vertices, pose, look: Look) -> float:
    shown = visible_faces(vertices, np.asarray(estimator.category.canonical.faces), look.camera, pose)
    return overlap_of(shown.mask[2::MASK_STRIDE, 2::MASK_STRIDE], look.object_probability > 0.5)
