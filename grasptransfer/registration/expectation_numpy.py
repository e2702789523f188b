"""The E-step with NumPy alone: chunks of targets against the source points near enough to matter.

Each chunk holds one array of pairs and goes over it as few times as it can: exponents come from one
matrix product, already shifted by the bound of each target's nearest distance.
"""

import numpy as np
from jaxtyping import Float

from grasptransfer.registration.blocks import BLOCK, GROUP

CHUNK = 256  # target points at once, at most
CHUNK_PAIRS = 600_000  # about so many pairs at once: they stay in the cache
SMALL = 60.0  # exponents that float32 holds with ease
COARSE = 2000.0  # |y|^2 / sigma^2 above which |x|^2 - 2 x y + |y|^2 in float32 is too coarse


def expect(targets, piece, rows, corners, kernel, found) -> tuple[Float[np.ndarray, "4 n"], float, float]:
    """What `expectation_compiled.expect` gives: P 1 and P X, sum of P times squared distance, log-likelihood.

    Args:
        rows: (3 + t, n) float32 source points and their traits.
        targets, piece, corners, kernel, found: as for the compiled one.
    """
    (all_points, traits), (first, last), (inlier, nearest) = targets, piece, found
    variance, reach, log_outlier = kernel
    moved, others = rows[:3], rows[3:]
    sums = np.zeros((4, moved.shape[1]))
    squared = likelihood = 0.0
    half = np.float32(0.5 / variance)
    size = min(CHUNK, max(CHUNK_PAIRS // moved.shape[1], GROUP))
    reached, shifts, centres = _near(all_points[:, first:last], size, corners, nearest[first:last], reach)
    for start, close, centre in zip(range(first, last, size), reached, centres, strict=True):
        chunk = slice(start, min(start + size, last))
        points = all_points[:, chunk]
        near = slice(None) if close.all() else np.repeat(close, BLOCK)[: moved.shape[1]].nonzero()[0]
        shift = shifts[start - first : chunk.stop - first]
        exponent = _exponents(points - centre, moved[:, near] - centre, shift, half)
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
        total = power @ np.ones(power.shape[1], np.float32)
        log_inlier = np.log(total) - half * shift
        log_all = np.logaddexp(log_inlier, log_outlier)
        inlier[chunk] = np.exp(log_inlier - log_all)
        share = inlier[chunk] / total
        if distance is None:
            squared += float(share @ (shift * total - np.einsum("gn,gn->g", power, exponent) / half))
        else:
            squared += float(share @ np.einsum("gn,gn->g", power, distance))
        likelihood += float(log_all.sum())
        sums[:, near] += _moments(points, share) @ power
    return sums, squared, likelihood


def _moments(points: Float[np.ndarray, "3 g"], share: Float[np.ndarray, "g"]) -> Float[np.ndarray, "4 g"]:
    """One and the coordinates of each target, times its share."""
    weighted = np.ones((4, points.shape[1]), np.float32)
    weighted[1:] = points
    weighted *= share
    return weighted


def _near(targets, size, corners, bounds, reach):
    """For each chunk: boxes that matter to it, bounds of the nearest squared distances, and its middle.

    As `_near_boxes` of the compiled kernel.
    """
    starts = np.arange(0, targets.shape[1], size)
    low = np.minimum.reduceat(targets, starts, axis=1)
    high = np.maximum.reduceat(targets, starts, axis=1)
    gaps = spans = np.float32(0)
    for axis in range(3):
        above, below = corners[0][axis] - high[axis, :, None], low[axis, :, None] - corners[1][axis]
        spans = spans + np.square(np.minimum(above, below))  # to the far side, of both the larger
        gaps = gaps + np.square(np.maximum(np.maximum(above, below), 0))
    bounds = np.minimum(bounds, np.repeat(spans.min(1), size)[: len(bounds)])
    limits = np.maximum.reduceat(bounds, starts) + reach
    return gaps <= limits[:, None], bounds, ((low + high) / 2).T[:, :, None]


def _exponents(
    points: Float[np.ndarray, "3 g"],
    moved: Float[np.ndarray, "3 n"],
    shift: Float[np.ndarray, "g"],
    half: np.float32,
) -> Float[np.ndarray, "g n"]:
    """(shift - |x - y|^2) / (2 sigma^2), by one matrix product or from differences; both clouds near 0."""
    lengths = np.einsum("in,in->n", moved, moved)
    if lengths.max() * half > COARSE / 2:
        return _exponents_by_difference(points, moved, shift, half)
    left, right = np.ones((5, points.shape[1]), np.float32), np.ones((5, moved.shape[1]), np.float32)
    left[:3], left[3], left[4] = (
        2 * half * points,
        half * (shift - np.einsum("ig,ig->g", points, points)),
        -half,
    )
    right[:3], right[4] = moved, lengths
    return left.T @ right


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
