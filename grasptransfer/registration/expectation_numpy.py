"""The E-step with NumPy alone: chunks of targets against the source points in their reach.

Each chunk holds one array of pairs and goes over it as few times as it can: exponents come from one
matrix product, already shifted by the bound of each target's nearest distance.
"""

import numpy as np
from jaxtyping import Float

from grasptransfer.registration.blocks import BLOCK

CHUNK = 64  # target points at once
SMALL = 60.0  # exponents that float32 holds with ease
COARSE = 2000.0  # |y|^2 / sigma^2 above which |x|^2 - 2 x y + |y|^2 in float32 is too coarse


def expect(
    targets, first, last, rows, corners, traits, variance, reach, log_outlier, inlier, nearest
) -> tuple[Float[np.ndarray, "4 n"], float, float]:
    """What `expectation_compiled.expect` gives: P 1 and P X, sum of P times squared distance, log-likelihood.

    Args:
        rows: (3 + t, n) float32 source points and their traits.
        corners: (3, b) least and (3, b) largest coordinates of their boxes.
    """
    moved, others = rows[:3], rows[3:]
    sums = np.zeros((4, moved.shape[1]))
    squared = likelihood = 0.0
    half = np.float32(0.5 / variance)
    for start in range(first, last, CHUNK):
        chunk = slice(start, min(start + CHUNK, last))
        points = targets[:, chunk]
        near, shift = _near(points, corners, nearest[chunk], reach, moved.shape[1])
        exponent = _exponents(points, moved[:, near], shift, half)
        best = exponent.max(1)
        nearest[chunk] = np.maximum(shift - best / half, 0)
        distance = None
        if len(others):
            distance = shift[:, None] - exponent / half
            exponent -= _trait_costs(traits[:, chunk], others[:, near])
            best = exponent.max(1)
        if np.abs(best).max() > SMALL:
            exponent -= best[:, None]
            shift = shift - best / half
        power = np.exp(exponent)
        total = power.sum(1)
        log_inlier = np.log(total.astype(float)) - half * shift
        log_all = np.logaddexp(log_inlier, log_outlier)
        inlier[chunk] = np.exp(log_inlier - log_all)
        share = inlier[chunk] / total
        if distance is None:
            squared += float(share @ (shift * total - np.einsum("gn,gn->g", power, exponent) / half))
        else:
            squared += float(share @ np.einsum("gn,gn->g", power, distance))
        likelihood += float(log_all.sum())
        weighted = np.concatenate([np.ones((1, points.shape[1]), np.float32), points]) * share
        sums[:, near] += weighted.astype(np.float32) @ power
    return sums, squared, likelihood


def _near(points, corners, bounds, reach, count):
    """Source points that matter to these targets, and their bounds of the nearest squared distance.

    As `_near_boxes` of the compiled kernel.
    """
    low, high = points.min(1)[:, None], points.max(1)[:, None]
    gap = np.maximum(np.maximum(corners[0] - high, low - corners[1]), 0)
    span = np.maximum(corners[1] - low, high - corners[0])
    bounds = np.minimum(bounds, np.square(span).sum(0).min())
    close = np.square(gap).sum(0) <= bounds.max() + reach
    return slice(None) if close.all() else np.flatnonzero(np.repeat(close, BLOCK)[:count]), bounds


def _exponents(
    points: Float[np.ndarray, "3 g"],
    moved: Float[np.ndarray, "3 n"],
    shift: Float[np.ndarray, "g"],
    half: np.float32,
) -> Float[np.ndarray, "g n"]:
    """(shift - |x - y|^2) / (2 sigma^2), by one matrix product centred on the chunk, or from differences."""
    centre = points.mean(1)[:, None]
    points, moved = points - centre, moved - centre
    lengths = np.einsum("in,in->n", moved, moved)
    if lengths.max() * half > COARSE / 2:
        return _exponents_by_difference(points, moved, shift, half)
    own = half * (shift - np.einsum("ig,ig->g", points, points))
    left = np.concatenate([(2 * half) * points, own[None], np.full((1, len(own)), -half)])
    return left.T @ np.concatenate([moved, np.ones((1, len(lengths)), np.float32), lengths[None]])


def _exponents_by_difference(points, moved, shift, half):
    """The same, three times slower and exact."""
    distance = np.square(points[0][:, None] - moved[0])
    for axis in (1, 2):
        difference = points[axis][:, None] - moved[axis]
        distance += np.square(difference, out=difference)
    np.subtract(shift[:, None], distance, out=distance)
    distance *= half
    return distance


def _trait_costs(own: Float[np.ndarray, "t g"], others: Float[np.ndarray, "t n"]) -> Float[np.ndarray, "g n"]:
    """What unlike traits cost, as exponents of e."""
    return np.float32(np.log(2)) * np.square(own[:, :, None] - others[:, None]).sum(0)
