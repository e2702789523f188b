"""The RGB estimator: zoom, network, visible motion, shape and pose."""

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.errors import PoseError, WeightsError
from grasptransfer.perception.augmentation import network_input
from grasptransfer.perception.canonical_view import CanonicalView, view_canonical
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.networks import FLOW_UNIT, MASK_STRIDE, OFFSET_UNIT
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_and_shape import (
    Motion,
    Outline,
    PoseAndShape,
    PosePrior,
    fit_pose_and_shape,
)
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.samples import NO_BOX_MARGIN, view_from_object
from grasptransfer.perception.silhouette import Silhouette
from grasptransfer.perception.weights import find_weights, load_weights
from grasptransfer.perception.zoom import (
    ZOOM_WIDTH,
    Box,
    enlarge,
    projected_box,
    union,
    zoom_box,
    zoom_camera,
    zoom_picture,
)

FEWEST_CELLS = 12  # fewer visible cells say nothing about a shape
ACCEPTED_SCORE = 0.5


@dataclass(frozen=True)
class Look:
    """One pass of the network over the zoomed picture.

    Args:
        camera: of the zoomed picture.
        view: canonical model at the assumed pose.
        motion: predicted motion of its visible cells.
        object_probability: (h / 4, w / 4) of the zoomed picture.
    """

    camera: Camera
    view: CanonicalView
    motion: Motion
    object_probability: Float[np.ndarray, "hh hw"]


class RgbEstimator:
    """From one RGB picture and an approximate pose to the shape; keeps network and renderer warm.

    Args:
        weights: a `.safetensors` file; None takes the one shipped for the category.
        refine_pose: fit the pose together with the shape.
        device: "auto", "cpu" or "cuda".
    """

    def __init__(
        self,
        category: Category,
        *,
        renderer: Renderer | None = None,
        weights: Path | None = None,
        refine_pose: bool = True,
        pose_prior: PosePrior | None = None,
        device: str = "auto",
    ):
        from grasptransfer.perception.training import choose_device

        self.category, self.refine_pose = category, refine_pose
        self.pose_prior = pose_prior or PosePrior()
        path = weights or find_weights(category.name)
        self.network, info = load_weights(path)
        if info.categories.get(category.name) != category.canonical_sha256:
            raise WeightsError(
                "was trained on another canonical model",
                path=path,
                key=category.name,
                value=info.categories.get(category.name),
                fix=f"Train again: grasptransfer train {category.name}",
            )
        self.device = torch.device(choose_device(device))
        self.network.to(self.device, memory_format=torch.channels_last)
        self.renderer = renderer or Renderer()

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Estimate the shape, and the pose where `refine_pose` is set."""
        clock = _Clock()
        pose = observation.camera_from_object
        # A second look, from the refined pose, starts where the first one ended.
        for _ in range(2 if self.refine_pose else 1):
            look = self.look(observation, pose)
            clock.lap("network")
            fit = fit_pose_and_shape(
                look.motion,
                look.view.cell_points,
                self.category.shape_space.displacement_model(look.view.cell_points),
                camera=look.camera,
                told_pose=observation.camera_from_object,
                start_pose=pose,
                pose_prior=self.pose_prior if self.refine_pose else None,
                outline=self._outline(look),
            )
            pose = fit.camera_from_object
            clock.lap("fit")
        field = self.category.shape_space.field(fit.latent)
        score = self._score(fit, look, field)
        clock.lap("score")
        status = EstimateStatus.OK if fit.converged else EstimateStatus.NOT_CONVERGED
        return ShapeEstimate(
            field=field,
            camera_from_object=fit.camera_from_object,
            latent=fit.latent,
            latent_covariance=fit.covariance[6:, 6:],
            mask=_whole_mask(look, observation.camera),
            category_score=score,
            status=status if score >= ACCEPTED_SCORE else EstimateStatus.OUT_OF_CATEGORY,
            timings=clock.seconds,
        )

    def look(self, observation: Observation, camera_from_object: Float[np.ndarray, "4 4"]) -> Look:
        """Zoom on the object at this pose and let the network compare it with the canonical model."""
        crop, told = _crop(self.category, observation, camera_from_object)
        camera = zoom_camera(observation.camera, crop)
        view = view_canonical(self.category.canonical, camera, camera_from_object, renderer=self.renderer)
        if len(view.cell_points) < FEWEST_CELLS:
            raise PoseError("the canonical model is not visible at this pose", key="pose")
        picture = zoom_picture(observation.image, crop)
        inputs = network_input(picture[None], told[None], view.coordinates[None])
        with torch.inference_mode(), torch.autocast(self.device.type, dtype=torch.bfloat16):
            prediction = self.network(inputs.to(self.device, memory_format=torch.channels_last))
        cells = torch.from_numpy(view.cell_mask).to(self.device)
        offset, offset_scale, flow, flow_scale = (
            part[0, :, cells].float().cpu().numpy().T.astype(float) for part in prediction[:4]
        )
        motion = Motion(
            offset * OFFSET_UNIT @ view_from_object(camera_from_object),
            np.exp(np.clip(offset_scale[:, 0], -5, 3)) * OFFSET_UNIT,
            view.cell_pixels + flow * FLOW_UNIT,
            np.exp(np.clip(flow_scale[:, 0], -5, 3)) * FLOW_UNIT,
        )
        probability = torch.sigmoid(prediction.mask_logit[0, 0].float()).cpu().numpy()
        return Look(camera, view, motion, probability)

    def _outline(self, look: Look) -> Outline:
        """What the reconstruction's outline has to meet in this look."""

        def draw_depth(vertices, pose):
            return self.renderer.depth(self._with_vertices(vertices), look.camera, pose)

        mean, basis = self._vertex_model
        silhouette = Silhouette(look.object_probability, look.camera, draw_depth)
        return Outline(silhouette, self._vertices, mean, basis)

    @cached_property
    def _vertices(self) -> Float[np.ndarray, "v 3"]:
        return np.asarray(self.category.canonical.vertices)

    @cached_property
    def _vertex_model(self) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3 k"]]:
        return self.category.shape_space.displacement_model(self._vertices)

    def _with_vertices(self, vertices: Float[np.ndarray, "v 3"]) -> trimesh.Trimesh:
        return trimesh.Trimesh(vertices, self.category.canonical.faces, process=False)

    def _score(self, fit: PoseAndShape, look: Look, field) -> float:
        """How well the reconstruction covers what the network takes for the object, in [0, 1]."""
        mesh = self.category.canonical.copy()
        mesh.vertices = field(np.asarray(mesh.vertices))
        silhouette = (
            self.renderer.depth(mesh, look.camera, fit.camera_from_object)[2::MASK_STRIDE, 2::MASK_STRIDE] > 0
        )
        seen = look.object_probability > 0.5
        overlap = (silhouette & seen).sum() / max((silhouette | seen).sum(), 1)
        # Beyond three standard deviations in every mode a shape is none of the category.
        unlikely = np.sqrt(np.mean(fit.latent**2)) / 3
        return float(overlap * np.exp(-max(0.0, unlikely - 1)))


def _crop(
    category: Category, observation: Observation, camera_from_object
) -> tuple[Box, Float[np.ndarray, "4"]]:
    """The zoom's box, and the told box in zoomed pixels (NaN: none)."""
    canonical_box = projected_box(
        np.asarray(category.canonical.vertices), observation.camera, camera_from_object
    )
    if observation.box is None:
        return zoom_box(enlarge(canonical_box, NO_BOX_MARGIN)), np.full(4, np.nan, np.float32)
    crop = zoom_box(union(canonical_box, observation.box))
    scale = ZOOM_WIDTH / (crop[2] - crop[0])
    told = (np.array(observation.box) - [crop[0], crop[1], crop[0], crop[1]]) * scale - 0.5
    return crop, told.astype(np.float32)


def _whole_mask(look: Look, camera: Camera) -> Bool[np.ndarray, "h w"]:
    """The predicted mask, put back into the whole picture."""
    scale_u, scale_v = look.camera.fx / camera.fx, look.camera.fy / camera.fy
    left = camera.cx - (look.camera.cx + 0.5) / scale_u
    top = camera.cy - (look.camera.cy + 0.5) / scale_v
    # PIL's affine map takes output pixel corners to input pixel corners.
    step_u, step_v = scale_u / MASK_STRIDE, scale_v / MASK_STRIDE
    matrix = (step_u, 0, -(left + 0.5) * step_u, 0, step_v, -(top + 0.5) * step_v)
    picture = Image.fromarray(look.object_probability.astype(np.float32))
    whole = picture.transform(
        (camera.width, camera.height), Image.Transform.AFFINE, matrix, Image.Resampling.BILINEAR, fillcolor=0
    )
    return np.asarray(whole) > 0.5


class _Clock:
    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str):
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
