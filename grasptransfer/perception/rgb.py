"""The RGB estimator: zoom, network, visible motion, shape and pose."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image
from scipy.special import expit

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.drawing.visible import visible_faces
from grasptransfer.errors import PoseError
from grasptransfer.frames import transform_points
from grasptransfer.jobs import single_blas_thread
from grasptransfer.perception.answering import load_answering
from grasptransfer.perception.canonical_view import CanonicalView, view_canonical
from grasptransfer.perception.confidence import Evidence, evidence
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.network_input import network_input, view_from_object, zoom_for
from grasptransfer.perception.networks import (
    FLOW_UNIT,
    LATENT_SIZE,
    OFFSET_UNIT,
    Prediction,
)
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_and_shape import (
    LatentPrior,
    Motion,
    Outline,
    PoseAndShape,
    fit_pose_and_shape,
)
from grasptransfer.perception.pose_prior import PosePrior
from grasptransfer.perception.seen_surface import ShapedModel
from grasptransfer.perception.silhouette import Silhouette
from grasptransfer.perception.weights import find_weights
from grasptransfer.perception.zoom import MASK_STRIDE, centre_on_box, zoom_camera, zoom_mask, zoom_picture

LOOKS = 2
ROUGH = 0.2  # of the given box's side: a pose that misses its centre by more is centred on it first
FEWEST_CELLS = 12  # fewer visible cells say nothing about a shape
NEAREST = 0.03  # m before the camera: a model that comes nearer, or lies behind it, fills no picture


@dataclass(frozen=True)
class Look:
    """One pass of the network over the zoomed picture.

    Args:
        camera: of the zoomed picture.
        view: the model as assumed: pose and latent.
        motion: predicted motion of its visible cells from the canonical model.
        latent: what the picture as a whole says of the latent.
        object_probability: (h / 4, w / 4) of the zoomed picture: as given, else as predicted.
        match: probability that the object is of the category.
    """

    camera: Camera
    view: CanonicalView
    motion: Motion
    latent: LatentPrior
    object_probability: Float[np.ndarray, "hh hw"]
    match: float


class RgbEstimator:
    """From one RGB picture and an approximate pose to the shape; warm, and usable from any thread.

    Args:
        weights: a `.safetensors` file; None takes the one shipped for the category.
        refine_pose: fit the pose together with the shape; without, every given pose is taken as exact.
        device: see `device.DEVICES`.
        precision: see `precision.PRECISIONS`.
    """

    def __init__(
        self,
        category: Category,
        *,
        weights: Path | None = None,
        refine_pose: bool = True,
        device: str = "auto",
        precision: str = "auto",
    ):
        self.category, self.refine_pose = category, refine_pose
        self._model = ShapedModel(category)
        path = weights or find_weights(category)
        self.network, info = load_answering(path, category, device=device, precision=precision)
        self.confidence = info.confidence

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Estimate the shape, and the pose where `refine_pose` is set."""
        return self.assess(observation)[0]

    def assess(self, observation: Observation) -> tuple[ShapeEstimate, Evidence]:
        """The estimate, and what its `category_score` rests on."""
        clock = _Clock()
        prior = PosePrior.of(observation.camera_from_object, observation.pose_covariance)
        prior = prior if self.refine_pose else None
        pose = observation.camera_from_object if prior is None else self._start(observation)
        latent = np.zeros(self.category.shape_space.n_modes)
        astray = False
        # The second look compares the picture with what the first one made of it.
        for number in range(LOOKS):
            try:
                look = self.look(observation, pose, latent)
            except PoseError:
                if number == 0:
                    raise
                astray = True  # the fit has lost the object: its answer stands, marked as unsettled
                break
            clock.lap("network")
            with single_blas_thread():
                fit = fit_pose_and_shape(
                    look.motion,
                    look.view.cell_points,
                    self.category.shape_space.displacement_model(look.view.cell_points),
                    camera=look.camera,
                    start_pose=pose,
                    pose_prior=prior,
                    latent_prior=look.latent,
                    outline=self._outline(look),
                )
            pose, latent = fit.camera_from_object, fit.latent
            clock.lap("fit")
        field = self.category.shape_space.field(fit.latent)
        found = evidence(look.match, self._overlap(fit, look), fit.latent)
        score = self.confidence.of_the_category(found)
        clock.lap("score")
        status = EstimateStatus.OK if fit.converged and not astray else EstimateStatus.NOT_CONVERGED
        estimate = ShapeEstimate(
            field=field,
            camera_from_object=fit.camera_from_object,
            latent=fit.latent,
            covariance=self.confidence.widened_with_pose(fit.covariance),
            mask=_whole_mask(look, observation.camera),
            category_score=score,
            status=status if score >= self.confidence.accepted_score else EstimateStatus.OUT_OF_CATEGORY,
            pose_sigma_prior=None if prior is None else prior.deviation,
            timings=clock.seconds,
        )
        return estimate, found

    def _start(self, observation: Observation) -> Float[np.ndarray, "4 4"]:
        """The given pose; one that lies far from the given box is first centred on it, as in training."""
        pose, camera, box = observation.camera_from_object, observation.camera, observation.box
        if box is None:
            return pose
        u0, v0, u1, v1 = projected_box(self._vertices, camera, pose)
        aside = np.hypot(box[0] + box[2] - u0 - u1, box[1] + box[3] - v0 - v1) / 2
        if aside < ROUGH * max(box[2] - box[0], box[3] - box[1]):
            return pose
        return centre_on_box(self._vertices, camera, pose, box)

    def look(
        self,
        observation: Observation,
        camera_from_object: Float[np.ndarray, "4 4"],
        latent: Float[np.ndarray, "k"],
    ) -> Look:
        """Zoom on the object and let the network compare it with the model at this pose, with this latent."""
        vertices = self._model.vertices(latent)
        nearest = transform_points(camera_from_object, vertices)[:, 2].min()
        if nearest < NEAREST:
            raise PoseError(
                f"brings the model nearer to the camera than {NEAREST} m, or behind it",
                key="pose",
                value=f"depth of its nearest point {nearest:.3f} m",
            )
        model_box = projected_box(vertices, observation.camera, camera_from_object)
        crop, told = zoom_for(model_box, observation.box)
        camera = zoom_camera(observation.camera, crop)
        view = view_canonical(self.category.canonical, camera, camera_from_object, vertices=vertices)
        if len(view.cell_points) < FEWEST_CELLS:
            raise PoseError("the canonical model is not visible at this pose", key="pose")
        picture = zoom_picture(observation.image, crop)
        prediction = self.network(network_input(picture[None], told[None], view.coordinates[None]))
        offset, offset_scale, flow, flow_scale = (
            part[0][:, view.cell_mask].T.astype(float) for part in prediction[:4]
        )
        motion = Motion(
            view.cell_places - view.cell_points + offset * OFFSET_UNIT @ view_from_object(camera_from_object),
            np.exp(np.clip(offset_scale[:, 0], -5, 3)) * OFFSET_UNIT,
            view.cell_pixels + flow * FLOW_UNIT,
            np.exp(np.clip(flow_scale[:, 0], -5, 3)) * FLOW_UNIT,
        )
        if observation.mask is not None:
            probability = zoom_mask(observation.mask, crop)
        else:
            probability = expit(prediction.mask_logit[0, 0])
        prior = _latent_prior(prediction, latent, self.confidence.latent_overconfidence)
        return Look(camera, view, motion, prior, probability, _match(prediction))

    def _outline(self, look: Look) -> Outline:
        """What the reconstruction's outline has to meet in this look."""

        faces = np.asarray(self.category.canonical.faces)

        def draw(vertices, pose):
            return visible_faces(vertices, faces, look.camera, pose).mask

        silhouette = Silhouette(look.object_probability, look.camera, draw)
        return Outline(silhouette, self._vertices, self.category.vertices_by_latent)

    @property
    def _vertices(self) -> Float[np.ndarray, "v 3"]:
        return np.asarray(self.category.canonical.vertices)

    def _overlap(self, fit: PoseAndShape, look: Look) -> float:
        """How well the reconstruction's silhouette covers the predicted mask: intersection over union."""
        faces, vertices = np.asarray(self.category.canonical.faces), self._model.vertices(fit.latent)
        shown = visible_faces(vertices, faces, look.camera, fit.camera_from_object)
        silhouette = shown.mask[2::MASK_STRIDE, 2::MASK_STRIDE]
        seen = look.object_probability > 0.5
        return float((silhouette & seen).sum() / max((silhouette | seen).sum(), 1))


def _latent_prior(
    prediction: Prediction, assumed: Float[np.ndarray, "k"], overconfidence: float
) -> LatentPrior:
    """What the latent head says; modes beyond its size, and networks without it, keep the prior.

    Args:
        overconfidence: how much larger the stated deviations have to be.
    """
    mean, deviation = np.zeros(len(assumed)), np.ones(len(assumed))
    if prediction.latent is None or prediction.latent_log_scale is None:
        return LatentPrior(mean, deviation)
    size = min(len(assumed), LATENT_SIZE)
    mean[:size] = assumed[:size] + prediction.latent[0, :size]
    log_scale = prediction.latent_log_scale[0, :size]
    deviation[:size] = np.minimum(overconfidence * np.exp(np.clip(log_scale, -4, 0)), 1)
    return LatentPrior(mean, deviation)


def _match(prediction: Prediction) -> float:
    if prediction.match_logit is None:
        return 1.0
    return float(expit(prediction.match_logit[0]))


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
