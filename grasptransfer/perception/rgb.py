"""The RGB estimator: zoom and network on each picture; shape and pose from all of them together."""

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
from grasptransfer.drawing.visible import visible_mask
from grasptransfer.errors import PoseError
from grasptransfer.frames import transform_points
from grasptransfer.jobs import single_blas_thread
from grasptransfer.perception.answering import load_answering
from grasptransfer.perception.arrangement import arrange
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
from grasptransfer.perception.picture_evidence import LatentPrior, Motion, Outline, PictureEvidence
from grasptransfer.perception.pose_and_shape import fit_pose_and_shape, widened_pose
from grasptransfer.perception.seen_surface import ShapedModel
from grasptransfer.perception.several_pictures import PicturePlace
from grasptransfer.perception.silhouette import Silhouette
from grasptransfer.perception.standing import Standing, Support
from grasptransfer.perception.weights import find_weights
from grasptransfer.perception.zoom import MASK_STRIDE, zoom_camera, zoom_mask, zoom_picture

LOOKS = 2
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
    """From RGB pictures and approximate poses to the shape; warm, and usable from any thread.

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
        given = arrange(observation, self._vertices, refine=self.refine_pose)
        poses, latent = given.start, given.latent(self.category.shape_space.n_modes)
        astray = False
        # The second pass compares the pictures with what the first one made of them.
        for number in range(LOOKS):
            try:
                looks = self._look_at_all(observation, given.places, poses, latent)
            except PoseError:
                if number == 0:
                    raise
                astray = True  # the fit has lost the object: its answer stands, marked as unsettled
                break
            clock.lap("network")
            with single_blas_thread():
                fit = fit_pose_and_shape(
                    [self._evidence(look) for look in looks],
                    poses,
                    given.priors,
                    places=given.places,
                    earlier=given.earlier,
                    standing=self._standing(observation.support),
                )
            poses, latent = fit.poses, fit.latent
            clock.lap("fit")
        overlaps = [
            self._overlap(fit.latent, place.camera_from_object(fit.poses), look)
            for place, look in zip(given.places, looks, strict=True)
        ]
        match = float(np.mean([look.match for look in looks]))
        found = evidence(match, float(np.mean(overlaps)), fit.latent)
        score = self.confidence.of_the_category(found)
        clock.lap("score")
        status = EstimateStatus.OK if fit.converged and not astray else EstimateStatus.NOT_CONVERGED
        posterior = given.posterior(fit, observation.camera_from_object)
        estimate = ShapeEstimate(
            field=self.category.shape_space.field(fit.latent),
            camera_from_object=fit.camera_from_object,
            latent=fit.latent,
            covariance=self.confidence.widened_with_pose(widened_pose(posterior.covariance)),
            mask=_whole_mask(looks[0], observation.camera),
            category_score=score,
            status=status if score >= self.confidence.accepted_score else EstimateStatus.OUT_OF_CATEGORY,
            pose_sigma_prior=given.sigma,
            posterior=posterior,
            timings=clock.seconds,
        )
        return estimate, found

    def _look_at_all(
        self,
        observation: Observation,
        places: tuple[PicturePlace, ...],
        poses: tuple[Float[np.ndarray, "4 4"], ...],
        latent: Float[np.ndarray, "k"],
    ) -> list[Look]:
        pairs = zip(observation.pictures, places, strict=True)
        return [self.look(picture, place.camera_from_object(poses), latent) for picture, place in pairs]

    def _evidence(self, look: Look) -> PictureEvidence:
        """What a picture says, for the fit."""
        points = look.view.cell_points
        model = self.category.shape_space.displacement_model(points)
        return PictureEvidence(look.motion, points, model, look.camera, self._outline(look), look.latent)

    def _standing(self, support: Support | None) -> Standing | None:
        return support and Standing(support, self._vertices, self.category.vertices_by_latent)

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
            return visible_mask(vertices, faces, look.camera, pose)

        silhouette = Silhouette(look.object_probability, look.camera, draw)
        return Outline(silhouette, self._vertices, self.category.vertices_by_latent)

    @property
    def _vertices(self) -> Float[np.ndarray, "v 3"]:
        return np.asarray(self.category.canonical.vertices)

    def _overlap(self, latent: Float[np.ndarray, "k"], pose: Float[np.ndarray, "4 4"], look: Look) -> float:
        """How well the reconstruction's silhouette covers the predicted mask: intersection over union."""
        faces, vertices = np.asarray(self.category.canonical.faces), self._model.vertices(latent)
        shown = visible_mask(vertices, faces, look.camera, pose)
        silhouette = shown[2::MASK_STRIDE, 2::MASK_STRIDE]
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
