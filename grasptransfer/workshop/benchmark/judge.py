"""Errors of estimates of one instance, its truth being known.

E compares shapes in the object's own frame, whatever pose was given. CPD does not estimate a pose: its field
also takes up the given pose's error, so its result is put back into the object's frame through the true pose.
`placed` is E of the shape at the given or refined pose, where the robot would expect the object.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import GraspTransferError
from grasptransfer.frames import invert, transform_points
from grasptransfer.perception.baselines import RigidEstimator
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.estimators import ESTIMATORS
from grasptransfer.perception.observation import Observation
from grasptransfer.workshop.benchmark.errors_of_shape import (
    CANONICAL_POINTS,
    TRUE_POINTS,
    CanonicalSurface,
    TrueSurface,
    outer_surface,
)
from grasptransfer.workshop.benchmark.registration_summary import MethodScores
from grasptransfer.workshop.benchmark.seen_instances import Instance


@dataclass(frozen=True)
class Judge:
    """Compares estimates of one instance with the truth."""

    instance: Instance
    surface: TrueSurface
    canonical: CanonicalSurface
    _answers: dict = field(default_factory=dict)

    @classmethod
    def of(cls, instance: Instance) -> "Judge":
        """With points of the true and the canonical outer surface."""
        return cls(
            instance,
            TrueSurface(outer_surface(instance.solid, TRUE_POINTS)),
            CanonicalSurface(outer_surface(instance.category.canonical, CANONICAL_POINTS)),
        )

    def ask(
        self,
        estimator: Estimator,
        observation: Observation,
        *,
        true_pose: Float[np.ndarray, "4 4"],
        method: str,
        scores: MethodScores,
    ) -> ShapeEstimate:
        """Add the errors of the estimator's answer to `scores`; none counts as the undeformed model.

        Args:
            estimator: the estimator to ask.
            observation: what the estimator sees.
            true_pose: (4, 4) true `camera_from_object` [m].
            method: the estimator's name.
            scores: scores of the method, or of the case in which it is measured.
        """
        try:
            estimate = estimator(observation)
        except GraspTransferError:  # The observation holds too little for an answer.
            estimate = RigidEstimator(self.instance.category)(observation)
            scores.failed += 1
        self.score(estimate, true_pose, method, scores=scores)
        return estimate

    def score(
        self,
        estimate: ShapeEstimate,
        true_pose: Float[np.ndarray, "4 4"],
        method: str,
        *,
        scores: MethodScores,
    ) -> None:
        """Add this estimate's errors to the method's; arguments as of `ask`.

        Args:
            estimate: the estimate to compare with the truth.
            true_pose, method, scores: as for `ask`.
        """
        points = self.canonical.warped(estimate.field)
        placed_points = transform_points(invert(true_pose) @ estimate.camera_from_object, points)
        holds_pose = method in ESTIMATORS and ESTIMATORS[method].field_holds_pose
        shape_points = placed_points if holds_pose else points
        error = self.surface.error(shape_points)
        moved = not np.allclose(shape_points, placed_points, atol=1e-6)
        scores.errors.append(error)
        scores.placed.append(self.surface.error(placed_points) if moved else error)
        if self.instance.exact:
            truth = self._once("truth", lambda: self.canonical.warped(self.instance.true_field))
            scores.correspondence_mm.append(float(np.linalg.norm(shape_points - truth, axis=1).mean()) * 1e3)
            if estimate.latent is not None and estimate.latent_covariance is not None:
                scores.covered.append(self._covered(estimate.latent, estimate.latent_covariance))

    def _covered(self, latent: np.ndarray, covariance: np.ndarray) -> float:
        """Share of the modes whose true value lies in the estimate's 90 % interval."""
        space = self.instance.category.shape_space
        true_latent = self._once("latent", lambda: space.encode(self.instance.true_field.weights))
        std = np.sqrt(np.diag(covariance))
        return float((np.abs(latent - true_latent) < 1.645 * std).mean())

    def _once(self, key: str, make: Callable[[], np.ndarray]) -> np.ndarray:
        if key not in self._answers:
            self._answers[key] = make()
        return self._answers[key]
