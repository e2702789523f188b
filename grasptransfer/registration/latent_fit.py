"""Fit a shape space, and where asked a pose, to a cloud of an instance (the paper's CLS).

| symbol | name |
| --- | --- |
| Z + mean(Z) + basis(Z) x | shape: `displacement_model` at the model points |
| R, t | `given_from_refined`: correction of the pose the cloud was expressed in |
| p_j | observed points, given object frame |

First EM with soft matches and a falling variance, as in CPD, but the M-step moves the latent and the
pose only: it gets past the wrong matches of a first guess. Then nonlinear least squares on nearest
points with analytic derivatives and a robust loss. The prior is the shape space's own, x ~ N(0, I).

Source: Rodriguez, Huber, Behnke 2020, section III (CLS); Rodriguez and Behnke, Transferring
Category-Based Functional Grasping Skills by Latent Space Non-Rigid Registration, 2018, eq. 9, whose
objective has neither prior nor visibility.
"""

import dataclasses
import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped

from grasptransfer.errors import NotSucceeded, SettingsError
from grasptransfer.frames import check_rigid
from grasptransfer.jobs import single_blas_thread
from grasptransfer.registration.blocks import BLOCK, spatial_order
from grasptransfer.registration.clouds import check_cloud, check_points
from grasptransfer.registration.expectation import EStep, log_outlier_term
from grasptransfer.registration.field import positive
from grasptransfer.registration.fit_residuals import FitResiduals, GaussianPosePrior, Posed
from grasptransfer.registration.shape_space import ShapeSpace
from grasptransfer.registration.visibility import visible_points

STAGES = 3  # of EM; visibility is computed at the start of each
STAGE_ITERATIONS = 15
SETTLED = 0.03  # largest step, in standard deviations of the prior, after which least squares takes over
OUTLIER_WEIGHT = 0.02
FINEST = 0.01  # sigma that EM may reach, of the scale: below the spacing of any model's points


class LatentFitStatus(enum.Enum):
    """Outcome of a fit; `advice` says what to do about it."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    POOR_FIT = "poor_fit"

    @property
    def advice(self) -> str:
        """One sentence for the user."""
        return {
            LatentFitStatus.CONVERGED: "The fit settled: the field can be used.",
            LatentFitStatus.ITERATION_LIMIT: "It did not settle: check the pose or raise max_iterations.",
            LatentFitStatus.POOR_FIT: "The cloud is unlike every known shape: check category and pose.",
        }[self]


@dataclass(frozen=True, eq=False)
class LatentFit:
    """A shape, and a corrected pose, that explain a cloud.

    Args:
        latent: (k,) standard deviations.
        joint_covariance: (6 + k, 6 + k) posterior covariance of turn about the refined object's origin [rad]
            and shift [m], both along the given object axes, and latent; 0 for a pose that was kept.
        given_from_refined: (4, 4) points of the refined object frame in the frame of the cloud.
        residual_rms: root mean square distance of observed points to their nearest model points [m].
        noise_std: standard deviation of the matches, as estimated [m].
        cost: half the robust squared residuals and the prior's: a negative log posterior.
        status: outcome, with advice.
        iterations: number of iterations of the least squares.
    """

    latent: Float[np.ndarray, "k"]
    joint_covariance: Float[np.ndarray, "s s"]
    given_from_refined: Float[np.ndarray, "4 4"]
    residual_rms: float
    noise_std: float
    cost: float
    status: LatentFitStatus
    iterations: int

    @property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """(k, k) of the latent; what is not known of the pose is in it."""
        return self.joint_covariance[6:, 6:]


@dataclass(frozen=True)
class Matching:
    """How the least squares of a fit match points.

    Args:
        robust_scale: residuals beyond this many standard deviations count less.
        sliding: how freely matches slide along the surface, 0 to 1: at 0 the distance between points is
            minimised, which holds a dense cloud where it was first matched.
        max_iterations: iterations of the least squares.

    Raises:
        SettingsError: `robust_scale` not positive, or `sliding` not within 0 and 1.
    """

    robust_scale: float = 3.0
    sliding: float = 0.8
    max_iterations: int = 50

    def __post_init__(self):
        object.__setattr__(self, "robust_scale", positive(self.robust_scale, "robust_scale"))
        if not 0 <= self.sliding <= 1:
            raise SettingsError("must be between 0 and 1", key="sliding", value=self.sliding)


def latent_fit(
    space: ShapeSpace,
    points_object: Shaped[np.ndarray, "..."],
    *,
    model_points: Float[np.ndarray, "p 3"] | None = None,
    initial_pose: Float[np.ndarray, "4 4"] | None = None,
    refine_pose: bool | GaussianPosePrior = False,
    viewpoint: Float[np.ndarray, "3"] | None = None,
    matching: Matching | None = None,
    strict: bool = False,
) -> LatentFit:
    """Fit latent and pose to a full or partial cloud.

    Args:
        space: shape space of the category.
        points_object: (m, 3) observed points in the given object frame [m].
        model_points: (p, 3) canonical surface points to match [m]; None takes the control points. Denser
            ones fit better.
        initial_pose: (4, 4) first guess of `given_from_refined`; None takes the identity.
        refine_pose: fit the pose, too. A prior says how far the given pose may be wrong; True takes
            `GaussianPosePrior.of_scale`.
        viewpoint: (3,) where the cloud was seen from, given object frame [m]; then hidden model points are
            not matched, and visible ones are drawn to the cloud. None where it was seen from all sides.
        matching: how residuals count, and for how long they are minimised; None takes the defaults.
        strict: raise when it did not succeed.

    Raises:
        PointCloudError: a cloud that is not (m, 3), not finite or without extent.
        PoseError: an initial pose that is not rigid.
        NotSucceeded: `strict`, and the status is not CONVERGED.
    """
    observed, matching = check_cloud(points_object, "points_object"), matching or Matching()
    if viewpoint is not None:
        viewpoint = check_points(np.reshape(viewpoint, (1, -1)), "viewpoint")[0]
    posed = _posed(space, model_points, initial_pose, refine_pose)
    with single_blas_thread():
        state, noise = _match_softly(posed, observed, space, viewpoint)
        visible = None if viewpoint is None else visible_points(posed.points(state), viewpoint)
        residuals = FitResiduals(posed, observed, noise, matching.robust_scale, visible, matching.sliding)
        # Nearest points have many local optima: what soft matches found competes with the first guess.
        fits = [_least_squares(residuals, first, matching.max_iterations) for first in (state, posed.start())]
        fit = min(fits, key=lambda candidate: candidate.cost)
    fit = _judge(fit, space)
    if strict and fit.status is not LatentFitStatus.CONVERGED:
        raise NotSucceeded(
            fit.status.advice, key="points_object", value=f"{fit.residual_rms * 1e3:.1f} mm RMS"
        )
    return fit


def _posed(space: ShapeSpace, model_points, initial_pose, refine_pose: bool | GaussianPosePrior) -> Posed:
    """The checked model at its first guess."""
    model = space.control_points if model_points is None else model_points
    model = check_points(model, "model_points", fewest=4)
    start = np.eye(4) if initial_pose is None else check_rigid(initial_pose, "initial_pose")
    prior = GaussianPosePrior.of_scale(space.scale) if refine_pose is True else refine_pose or None
    model = model[spatial_order(model, BLOCK)]
    return Posed(model, space.displacement_model(model), start, prior)


def _match_softly(
    posed: Posed, observed, space: ShapeSpace, viewpoint
) -> tuple[Float[np.ndarray, "s"], float]:
    """EM over latent and pose; the state, and sigma [m]."""
    normaliser = space.normaliser
    target = normaliser(observed)
    state = posed.start()
    moved = posed.points(state)
    variance = float(np.square(moved - moved.mean(0)).sum(1).mean()) / 3 / 16
    for _ in range(STAGES):
        moved = posed.points(state)
        chosen = _visible(moved, viewpoint)
        with EStep(target, int(chosen.sum()), threads=1) as expect:
            for _ in range(STAGE_ITERATIONS):
                moved = posed.points(state)[chosen]
                sigma = variance / space.scale**2
                outlier = log_outlier_term(OUTLIER_WEIGHT, sigma, source=len(moved), volume=len(target))
                found = expect(normaliser(moved), sigma, log_outlier=outlier)
                means = normaliser.undo(found.moment / np.maximum(found.support, 1e-9)[:, None])
                weights = found.support / variance
                step = posed.step(state, chosen, weights, np.where(weights[:, None] > 0, means - moved, 0.0))
                state = state + step
                squared = found.squared * space.scale**2 / (3 * max(found.support.sum(), 1e-9))
                variance = max(min(squared, variance), (FINEST * space.scale) ** 2)
                if np.abs(step * posed.root_precision).max(initial=0.0) < SETTLED:
                    break
    return state, float(np.sqrt(variance))


def _least_squares(residuals: FitResiduals, state: Float[np.ndarray, "s"], max_iterations: int) -> LatentFit:
    """Nearest points, robust loss, analytic derivatives."""
    from scipy.optimize import least_squares

    solution = least_squares(
        residuals.values,
        state,
        residuals.jacobian,  # pyright: ignore[reportArgumentType]
        method="lm",
        max_nfev=max_iterations,
        ftol=1e-5,
        xtol=1e-5,
    )
    posed, covariance = residuals.posed, np.linalg.inv(residuals.information(solution.x))
    return LatentFit(
        latent=solution.x[-posed.n_modes :],
        joint_covariance=posed.joint(covariance, solution.x),
        given_from_refined=posed.pose(solution.x),
        residual_rms=float(np.sqrt(np.square(residuals.nearest(solution.x)).sum(1).mean())),
        noise_std=residuals.noise,
        cost=float(solution.cost),
        status=LatentFitStatus.CONVERGED if solution.status > 0 else LatentFitStatus.ITERATION_LIMIT,
        iterations=int(solution.nfev),
    )


def _visible(points: Float[np.ndarray, "p 3"], viewpoint) -> Bool[np.ndarray, "p"]:
    return np.ones(len(points), bool) if viewpoint is None else visible_points(points, viewpoint)


def _judge(fit: LatentFit, space: ShapeSpace) -> LatentFit:
    """A fit whose points lie a quarter of the object off explains nothing."""
    if fit.residual_rms > 0.25 * space.scale or np.sqrt(np.square(fit.latent).mean()) > 5:
        return dataclasses.replace(fit, status=LatentFitStatus.POOR_FIT)
    return fit
