"""Coherent Point Drift: the smooth field that takes a source cloud to a target cloud.

The target is a sample of a Gaussian mixture around the moved source points; EM alternates between
who belongs to whom (P) and the smoothest field that brings them together.

| symbol | name |
| --- | --- |
| Y, X | source, target, both normalised by the source's centre and RMS radius |
| G = L L^T | `PreparedSource.factor` (L) |
| T = Y + G W = Y + L c | `moved`, `coefficients` (c = L^T W) |
| P 1, P X, P^T 1 | `Expectation.support`, `.moment`, `.inlier` |
| sigma^2, lambda, w | `variance`, `lam`, `outlier_weight` |
| V | `outlier_volume`, where outliers are spread evenly |

Source: Myronenko and Song, Point Set Registration: Coherent Point Drift, 2010, figure 4. Given
correspondences: Golyanik, Taetz, Reis, Stricker, Extended CPD, 2016, eq. 8. The low-rank M-step is
exact for G = L L^T: (L^T diag(P 1) L + lambda sigma^2 I) c = L^T (P X - P 1 Y).

The paper's outliers have the density 1 / M, M the number of target points, which belongs to no volume. A
given w keeps it. With it an estimated w falls to 0 in close clutter; that one takes 1 / V, V the ball around
the target. EM then starts twice, from a small w that follows at once and from a large one that is held until
sigma^2 has settled, and the run with the lower objective is kept.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float, Shaped

from grasptransfer.errors import NotSucceeded
from grasptransfer.frames import transform_points
from grasptransfer.jobs import single_blas_thread
from grasptransfer.registration.alignment import align
from grasptransfer.registration.cpd_input import (
    Correspondences,
    Options,
    PreparedSource,
    check_correspondences,
    check_target,
    check_traits,
)
from grasptransfer.registration.cpd_result import CpdProgress, CpdResult, CpdStatus
from grasptransfer.registration.expectation import EStep, Expectation, log_outlier_term
from grasptransfer.registration.field import DeformationField
from grasptransfer.registration.kernels import weighted_ridge

SETTLED = 100  # tolerances by which sigma^2 may still change when a held w is let go
STEADY_WEIGHT = 1e-4  # change of an estimated w with which EM may end
VARIANCE_FLOOR = 1e-8  # normalised: sigma of 1e-4 of the RMS radius, where float32 distances end


def cpd(
    source: Shaped[np.ndarray, "..."] | PreparedSource,
    target: Shaped[np.ndarray, "..."],
    *,
    beta: float | None = None,
    lam: float = 2.0,
    outlier_weight: float | str = 0.0,
    tolerance: float = 1e-7,
    max_iterations: int = 150,
    align_first: str = "none",
    correspondences: Shaped[np.ndarray, "..."] | None = None,
    correspondence_std: float | None = None,
    source_traits: Shaped[np.ndarray, "..."] | None = None,
    target_traits: Shaped[np.ndarray, "..."] | None = None,
    trait_std: float = 1.0,
    backend: str = "auto",
    threads: int | None = None,
    callback: Callable[[CpdProgress], bool | None] | None = None,
    strict: bool = False,
) -> CpdResult:
    """Register a source cloud to a target cloud without known correspondences.

    Args:
        source: (n, 3) [m], or a `PreparedSource` that is used for many targets.
        target: (m, 3) [m], same frame as the source, or any with `align_first`.
        beta: width of the kernel in units of the source's RMS radius; 2 by default. Larger moves
            neighbours more together.
        lam: weight of smoothness against fit.
        outlier_weight: share of target points without counterpart, 0 <= w < 1, or "estimate": as the data
            say, from two starts.
        tolerance: stop once sigma^2 changes by less, normalised; 0 runs all iterations.
        max_iterations: most iterations of EM, from each start.
        align_first: "none", "rigid", "similarity" or "affine": remove such a motion of the whole
            cloud first (`CpdResult.target_from_source`); the field is what remains.
        correspondences: (c, 2) known pairs: index of a source point, index of a target point.
        correspondence_std: their accuracy [m]; 1 % of the source's RMS radius by default.
        source_traits: (n, t) colours or normals of the source points, optional.
        target_traits: (m, t) the same of the target points.
        trait_std: how much the traits of matching points differ.
        backend: "auto", "compiled" (numba) or "numpy": same results.
        threads: threads of the E-step; None takes the available cores.
        callback: is called after each iteration; returning True stops the registration.
        strict: raise when the iteration limit is hit.

    Raises:
        PointCloudError: clouds that are not (m, 3), not finite, without extent, in other units or
            elsewhere than the source, or with far outliers at `outlier_weight` 0.
        SettingsError: an option outside its range.
        NotSucceeded: `strict`, and the iteration limit was hit.
    """
    options = Options.checked(lam, outlier_weight, tolerance, max_iterations)
    source = _prepared(source, beta)
    target = check_target(target, source, align_first=align_first, outlier_weight=options.outlier_weight)
    with single_blas_thread():
        weight = options.starts[0][0]
        target_from_source = align(
            source.points, target, align_first, outlier_weight=weight, backend=backend, threads=threads
        )
        seen = source.normaliser(transform_points(np.linalg.inv(target_from_source), target))
        known = check_correspondences(correspondences, correspondence_std, source, seen)
        traits = check_traits(source_traits, target_traits, trait_std, source, seen)
        with EStep(seen, source.count, traits=traits, backend=backend, threads=threads) as expect:
            run, status = _lowest(source, seen, known, options, expect, callback=callback)
            result = run.result(status, target_from_source)
    if strict and status is CpdStatus.ITERATION_LIMIT:
        raise NotSucceeded(status.advice, key="max_iterations", value=max_iterations)
    return result


def cpd_all(
    source: PreparedSource, targets: Iterable[Shaped[np.ndarray, "..."]], *, workers: int = 2, **options
) -> list[CpdResult]:
    """Register one prepared source to many targets in parallel, in their order.

    Args:
        source: the source of all of them.
        targets: clouds (m, 3) [m], as for `cpd`.
        workers: registrations that run at once, each in one thread.
        options: options of `cpd`.

    Raises:
        PointCloudError, SettingsError, NotSucceeded: what `cpd` raises for the first target that fails.
    """
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda target: cpd(source, target, threads=1, **options), targets))


def _prepared(source: Shaped[np.ndarray, "..."] | PreparedSource, beta: float | None) -> PreparedSource:
    if not isinstance(source, PreparedSource):
        source = PreparedSource(source, beta=2.0 if beta is None else beta)
    source.check_beta(beta)
    return source


def _lowest(
    source: PreparedSource,
    target: Float[np.ndarray, "m 3"],
    known: Correspondences,
    options: Options,
    expect: EStep,
    *,
    callback: Callable[[CpdProgress], bool | None] | None,
) -> "tuple[_Run, CpdStatus]":
    """Of the runs from each start the one with the lowest objective, and its status."""
    ended: list[tuple[_Run, CpdStatus]] = []
    for weight, held in options.starts:
        run = _Run(source, target, known, options, expect)
        run.outlier_weight, run.holds_weight = weight, held
        ended.append((run, run.iterate(callback)))
        if ended[-1][1] is CpdStatus.STOPPED:
            break
    return min(ended, key=lambda one: one[0].objective_history[-1])


class _Run:
    """State of one EM, in normalised units and in the order of `PreparedSource`."""

    def __init__(
        self,
        source: PreparedSource,
        target: Float[np.ndarray, "m 3"],
        known: Correspondences,
        options: Options,
        expect: EStep,
    ):
        self.source, self.target, self.known = source, target, known
        self.options, self.expect = options, expect
        self.coefficients = np.zeros((source.factor.shape[1], 3))
        self.moved = source.normalised
        self.variance = _mean_squared_distance(self.moved, target) / 3
        self.outlier_weight, self.holds_weight = options.starts[0]
        self.outlier_volume = float(len(target))
        if options.estimates_outliers:
            radius = np.linalg.norm(target - target.mean(0), axis=1).max()
            self.outlier_volume = min(self.outlier_volume, float(4 / 3 * np.pi * radius**3))
        self.objective_history: list[float] = []

    def iterate(self, callback) -> CpdStatus:
        scratch = np.empty_like(self.source.factor)
        tolerance, limit = self.options.tolerance, self.options.max_iterations
        for iteration in range(limit):
            weight = self.outlier_weight
            outlier = log_outlier_term(
                weight, self.variance, source=self.source.count, volume=self.outlier_volume
            )
            expectation = self.expect(self.moved, self.variance, log_outlier=outlier)
            self.objective_history.append(self._objective(expectation))
            change = self._maximise(expectation, scratch)
            self.expectation = expectation
            if callback and callback(self._progress()):
                return CpdStatus.STOPPED
            if tolerance and self.variance <= VARIANCE_FLOOR:
                return CpdStatus.VARIANCE_FLOOR
            if self.holds_weight:
                self.holds_weight = abs(change) >= SETTLED * tolerance and iteration < limit // 2
            elif abs(change) < tolerance and abs(self.outlier_weight - weight) < STEADY_WEIGHT:
                return CpdStatus.CONVERGED
        return CpdStatus.ITERATION_LIMIT

    def _maximise(self, expectation: Expectation, scratch: Float[np.ndarray, "n r"]) -> float:
        """M-step: the field for this variance, then the variance for this field; its change."""
        support, factor = expectation.support, self.source.factor
        pull = expectation.moment - support[:, None] * self.source.normalised
        weights, pull = self.known.join(support, pull, self.variance)
        damping = self.options.lam * self.variance
        self.coefficients = weighted_ridge(factor, weights, damping, pull, scratch=scratch)
        before = self.moved
        self.moved = self.source.normalised + factor @ self.coefficients.astype(factor.dtype)
        step = self.moved - before
        # Sum of P |x - T|^2, from its value before the step: no large terms cancel.
        halfway = expectation.moment - support[:, None] * (before + step / 2)
        squared = expectation.squared - 2 * np.einsum("ni,ni->", step, halfway)
        matched = max(float(support.sum()), 1e-12)
        previous, self.variance = self.variance, max(float(squared) / (3 * matched), VARIANCE_FLOOR)
        if self.options.estimates_outliers and not self.holds_weight:
            self.outlier_weight = float(np.clip(1 - matched / len(self.target), 1e-6, 0.95))
        return previous - self.variance

    def _objective(self, expectation: Expectation) -> float:
        """Negative log-likelihood and lambda / 2 tr(W^T G W), which EM never lets rise."""
        constant = 1.5 * np.log(2 * np.pi * self.variance) - np.log1p(-self.outlier_weight)
        likelihood = expectation.log_likelihood - len(self.target) * (constant + np.log(self.source.count))
        bending = 0.5 * self.options.lam * np.vdot(self.coefficients, self.coefficients)
        return float(bending - likelihood + self.known.cost(self.moved))

    def _progress(self) -> CpdProgress:
        return CpdProgress(
            iteration=len(self.objective_history),
            moved=self.source.normaliser.undo(self.source.unordered(self.moved)),
            variance=self.variance * self.source.normaliser.scale**2,
            objective=self.objective_history[-1],
        )

    def result(self, status: CpdStatus, target_from_source: Float[np.ndarray, "4 4"]) -> CpdResult:
        normaliser, unordered = self.source.normaliser, self.source.unordered
        weights = unordered(self.source.kernel.shortest_weights(self.coefficients))
        support = np.maximum(self.expectation.support, 1e-12)[:, None]
        return CpdResult(
            field=DeformationField(
                self.source.points, weights, self.source.beta, normaliser.centre, normaliser.scale
            ),
            status=status,
            iterations=len(self.objective_history),
            variance=self.variance * normaliser.scale**2,
            variance_floor=VARIANCE_FLOOR * normaliser.scale**2,
            objective_history=tuple(self.objective_history),
            source_support=unordered(self.expectation.support),
            target_inlier=self.expectation.inlier,
            matched_targets=normaliser.undo(unordered(self.expectation.moment / support)),
            outlier_weight=self.outlier_weight,
            target_from_source=target_from_source,
        )


def _mean_squared_distance(points_a: Float[np.ndarray, "n 3"], points_b: Float[np.ndarray, "m 3"]) -> float:
    """Over all pairs, without making them."""
    middle_a, middle_b = points_a.mean(0), points_b.mean(0)
    spread = np.square(points_a - middle_a).sum(1).mean() + np.square(points_b - middle_b).sum(1).mean()
    return float(spread + np.square(middle_a - middle_b).sum())
