"""Rigid, similarity and affine CPD: the motion of a whole cloud that comes before a field.

Source: Myronenko and Song 2010, figures 2 and 3. EM as in `cpd`, but the M-step fits one transform.
"""

import numpy as np
from jaxtyping import Float

from grasptransfer.registration.blocks import BLOCK, spatial_order
from grasptransfer.registration.clouds import Normaliser
from grasptransfer.registration.expectation import EStep, log_outlier_term

ALIGNMENTS = ("none", "rigid", "similarity", "affine")
ITERATIONS = 100
TOLERANCE = 1e-7


def align(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "m 3"],
    kind: str,
    *,
    outlier_weight: float = 0.0,
    backend: str = "auto",
    threads: int | None = None,
) -> Float[np.ndarray, "4 4"]:
    """The affine `target_from_source` [m] that brings the source nearest to the target.

    Both clouds are first centred (and for "similarity" and "affine" scaled) on each other. A turn of
    more than about 60 degrees is not found.

    Args:
        source: (n, 3) [m].
        target: (m, 3) [m], any frame.
        kind: "none" (the identity), "rigid", "similarity" or "affine".
        outlier_weight: share of target points without counterpart.
        backend, threads: backend and threads of the E-step, as for `cpd`.
    """
    if kind == "none":
        return np.eye(4)
    own, other = _robust(source), _robust(target)
    if kind == "rigid":  # one scale for both: a rigid motion must not hide a difference in size
        other = Normaliser(other.centre, own.scale)
    source, target = own(source), other(target)
    source = source[spatial_order(source, BLOCK)]
    with EStep(target, len(source), backend=backend, threads=threads) as expect:
        linear, shift = _register(expect, source, target, kind, outlier_weight)
    target_from_source = np.eye(4)
    target_from_source[:3, :3] = linear * other.scale / own.scale
    target_from_source[:3, 3] = other.centre + other.scale * shift - target_from_source[:3, :3] @ own.centre
    return target_from_source


def _robust(points: Float[np.ndarray, "m 3"]) -> Normaliser:
    """A normaliser that far outliers do not move much."""
    middle = np.median(points, axis=0)
    near = np.linalg.norm(points - middle, axis=1)
    return Normaliser.of(points[near <= 4 * np.median(near)])


def _register(
    expect: EStep,
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "m 3"],
    kind: str,
    outlier_weight: float,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """EM: linear part and shift that bring the source nearest to the target, both normalised."""
    linear, shift = np.eye(3), np.zeros(3)
    middle = target - target.mean(0)
    variance = float(np.square(source).sum(1).mean() + np.square(middle).sum(1).mean()) / 3
    for _ in range(ITERATIONS):
        outlier = log_outlier_term(outlier_weight, variance, source=len(source), volume=len(target))
        moved = source @ linear.T + shift
        found = expect(moved, variance, log_outlier=outlier)
        linear, shift = _fit(source, found.support, found.moment, kind)
        step = source @ linear.T + shift - moved
        pull = found.moment - found.support[:, None] * moved
        squared = found.squared + np.sum(found.support[:, None] * step**2 - 2 * step * pull)
        previous, variance = variance, max(float(squared / (3 * found.support.sum())), 1e-8)
        if abs(previous - variance) < TOLERANCE:
            break
    return linear, shift


def _fit(
    source: Float[np.ndarray, "n 3"],
    support: Float[np.ndarray, "n"],
    moment: Float[np.ndarray, "n 3"],
    kind: str,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Linear part and shift that take the source to the weighted means of its targets."""
    total = support.sum()
    source_mean, target_mean = support @ source / total, moment.sum(0) / total
    centred = source - source_mean
    cross = (moment - support[:, None] * target_mean).T @ centred
    spread = (support[:, None] * centred).T @ centred
    if kind == "affine":
        # A flat cloud says nothing about one direction; there the linear part stays a rotation.
        linear = cross @ np.linalg.pinv(spread, rcond=1e-9, hermitian=True)
        if np.linalg.matrix_rank(spread, tol=1e-9 * np.trace(spread)) == 3:
            return linear, target_mean - linear @ source_mean
        kind = "similarity"
    left, stretch, right = np.linalg.svd(cross)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    linear = (left * signs) @ right
    if kind == "similarity":
        linear = linear * float((stretch * signs).sum() / np.trace(spread))
    return linear, target_mean - linear @ source_mean
