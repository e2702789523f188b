"""The RGB estimator: zoom and network on each picture; shape and pose from all of them together."""

import time
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from grasptransfer.category import Category
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.drawing.visible import visible_mask
from grasptransfer.errors import PoseError
from grasptransfer.frames import transform_points
from grasptransfer.jobs import single_blas_thread
from grasptransfer.perception.answering import load_answering
from grasptransfer.perception.arrangement import Arrangement, arrange
from grasptransfer.perception.canonical_view import view_canonical
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.explanation import reconsider
from grasptransfer.perception.look import Look, latent_prior, predicted_motion
from grasptransfer.perception.network_input import network_input, zoom_for
from grasptransfer.perception.networks import (
    FLOW_UNIT,
)
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.picture_evidence import Outline, PictureEvidence
from grasptransfer.perception.pose_and_shape import PoseAndShape, fit_pose_and_shape
from grasptransfer.perception.seen_surface import ShapedModel
from grasptransfer.perception.several_pictures import PicturePlace
from grasptransfer.perception.signs import (
    Signs,
    drift_of,
    overlap_of,
    signs_of_fit,
    signs_of_pass,
    structure_of,
)
from grasptransfer.perception.silhouette import Silhouette
from grasptransfer.perception.standing import Standing, Support
from grasptransfer.perception.weights import find_weights
from grasptransfer.perception.zoom import MASK_STRIDE, whole_mask, zoom_camera, zoom_mask, zoom_picture

LOOKS = 2
FEWEST_CELLS = 12  # fewer visible cells say nothing about a shape
LEAST_STRUCTURE = 0.3  # of noise it is below 0.1, of 33 dark, grainy or blurred photographs above 0.9
NEAREST = 0.03  # m before the camera: a model that comes nearer, or lies behind it, fills no picture


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
        estimate, signs = self.assess(observation)
        camera = observation.camera
        given = projected_box(self._vertices, camera, observation.camera_from_object)
        assert estimate.latent is not None
        found = projected_box(self._model.vertices(estimate.latent), camera, estimate.camera_from_object)
        return reconsider(estimate, signs, observation, assessor=self, boxes=(given, found))

    def assess(self, observation: Observation) -> tuple[ShapeEstimate, Signs]:
        """The estimate, and the signs that its status rests on; `__call__` also asks for the likely cause."""
        clock = _Clock()
        given = arrange(observation, self._vertices, refine=self.refine_pose)
        poses, latent = given.start, given.latent(self.category.shape_space.n_modes)
        first: list[Look] | None = None
        lost = False
        # The second pass compares the pictures with what the first one made of them.
        for number in range(LOOKS):
            try:
                looks = self._look_at_all(observation, given.places, poses, latent)
            except PoseError:
                if number == 0:
                    raise
                lost = True  # the fit has lost the object: its answer stands, marked as unsettled
                break
            first = looks if first is None else first
            clock.lap("network")
            evidence = [self._evidence(look) for look in looks]
            fit = self._fit(evidence, poses, given=given, support=observation.support)
            poses, latent = fit.poses, fit.latent
            clock.lap("fit")
        signs = self._signs(first or looks, looks, evidence, fit=fit, given=given)
        status, score = self.confidence.judge(signs, settled=fit.converged and not lost)
        if max(look.structure for look in looks) < LEAST_STRUCTURE:
            status, score = EstimateStatus.NOTHING_SEEN, 0.0
        clock.lap("score")
        posterior = given.posterior(fit, observation.camera_from_object)
        estimate = ShapeEstimate(
            field=self.category.shape_space.field(fit.latent),
            camera_from_object=fit.camera_from_object,
            latent=fit.latent,
            covariance=self.confidence.widened_with_pose(posterior.covariance),
            mask=whole_mask(looks[0].object_probability, looks[0].camera, observation.camera),
            category_score=score,
            status=status,
            pose_sigma_prior=given.sigma,
            posterior=posterior,
            timings=clock.seconds,
        )
        return estimate, signs

    def preference(self, observation: Observation) -> float:
        """How well the observation's pose explains its picture, by one pass of the network.

        Of several poses for one picture the highest is preferred; differences are logarithms of odds.

        Raises:
            PoseError: the model at this pose fills no picture.
        """
        latent = np.zeros(self.category.shape_space.n_modes)
        start = arrange(observation, self._vertices, refine=self.refine_pose).start[0]
        return self.confidence.preference(self.look(observation, start, latent).signs)

    def _fit(
        self,
        evidence: list[PictureEvidence],
        poses: tuple[Float[np.ndarray, "4 4"], ...],
        *,
        given: Arrangement,
        support: Support | None,
    ) -> PoseAndShape:
        """Shape and poses that explain the evidence, from these poses on."""
        with single_blas_thread():
            return fit_pose_and_shape(
                evidence,
                poses,
                given.priors,
                places=given.places,
                earlier=given.earlier,
                standing=self._standing(support),
                overconfidence=given.overconfidence,
            )

    def _signs(
        self,
        first: list[Look],
        last: list[Look],
        evidence: list[PictureEvidence],
        *,
        fit: PoseAndShape,
        given: Arrangement,
    ) -> Signs:
        """Signs of a wrong input: the means over several pictures."""
        vertices = self._model.vertices(fit.latent)
        sides = np.ptp(vertices, axis=0) / np.ptp(self._vertices, axis=0)
        drifted = drift_of(given.start[0], fit.camera_from_object, given.priors[0])
        of_fit = []
        for place, look, said in zip(given.places, last, evidence, strict=True):
            pose = place.camera_from_object(fit.poses)
            cover = self._overlap(vertices, pose, look)
            of_fit.append(signs_of_fit(said, pose, fit, overlap=cover, sides=sides, drifted=drifted))
        passes = [np.mean([look.signs for look in looks], axis=0) for looks in (first, last)]
        return np.concatenate([*passes, np.mean(of_fit, axis=0)])

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
        crop, given_box = zoom_for(model_box, observation.box)
        camera = zoom_camera(observation.camera, crop)
        view = view_canonical(self.category.canonical, camera, camera_from_object, vertices=vertices)
        if len(view.cell_points) < FEWEST_CELLS:
            raise PoseError("the canonical model is not visible at this pose", key="pose")
        picture = zoom_picture(observation.image, crop)
        prediction = self.network(network_input(picture[None], given_box[None], view.coordinates[None]))
        motion = predicted_motion(prediction, view, camera_from_object)
        probability = expit(prediction.mask_logit[0, 0])
        assert prediction.flow_spread is not None
        assert prediction.mask_spread is not None
        prior = latent_prior(prediction, latent, self.confidence.latent_overconfidence)
        signs = signs_of_pass(
            view,
            motion,
            prior,
            match_logit=10.0 if prediction.match_logit is None else float(prediction.match_logit[0]),
            mask=probability,
            flow_spread=prediction.flow_spread[0][view.cell_mask] * FLOW_UNIT,
            mask_spread=prediction.mask_spread[0],
        )
        if observation.mask is not None:
            probability = zoom_mask(observation.mask, crop)
        return Look(camera, view, motion, prior, probability, signs, structure_of(observation.image, crop))

    def _outline(self, look: Look) -> Outline:
        """What the reconstruction's outline has to meet in this picture."""
        faces = np.asarray(self.category.canonical.faces)

        def draw(vertices, pose):
            return visible_mask(vertices, faces, look.camera, pose)

        silhouette = Silhouette(look.object_probability, look.camera, draw)
        return Outline(silhouette, self._vertices, self.category.vertices_by_latent)

    @property
    def _vertices(self) -> Float[np.ndarray, "v 3"]:
        return np.asarray(self.category.canonical.vertices)

    def _overlap(
        self, vertices: Float[np.ndarray, "v 3"], pose: Float[np.ndarray, "4 4"], look: Look
    ) -> float:
        """How well the reconstruction's silhouette covers the predicted mask: intersection over union."""
        shown = visible_mask(vertices, np.asarray(self.category.canonical.faces), look.camera, pose)
        return overlap_of(shown[2::MASK_STRIDE, 2::MASK_STRIDE], look.object_probability > 0.5)


class _Clock:
    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str):
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
