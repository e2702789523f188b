"""The E-step of CPD: how likely each target point came from each source point, summed up.

| symbol | name |
| --- | --- |
| P_nm | never stored |
| P 1 | `Expectation.support` |
| P X | `Expectation.moment` |
| P^T 1 | `Expectation.inlier` |
| sum P_nm |x_m - T(y_n)|^2 | `Expectation.squared` |

Two backends give the same results: a compiled loop (numba), and NumPy on chunks of pairs. Both skip
pairs of boxes that are out of reach once sigma is small. Source: Myronenko and Song 2010, eq. 6.
"""

import importlib.util
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.registration.blocks import BLOCK, GROUP, spatial_order

BACKENDS = ("auto", "compiled", "numpy")
CUTOFF = 18.0  # pairs less likely by e^-18 than the nearest one do not count
LARGEST_EXPONENT = 80.0  # float32's smallest normal number is e^-87
CHUNK = 128  # target points that NumPy treats at once
FEWEST_PAIRS = 400_000  # for each thread; handing over less costs more than it saves
PRODUCT_ABOVE = 1e-3  # sigma^2 below which |x|^2 - 2 x y + |y|^2 in float32 is too coarse
FAR = 1e9  # where source points that only fill up a box are put
NO_OUTLIERS = -1e30  # log of an outlier term of zero


@dataclass(frozen=True, eq=False)
class Expectation:
    """What the M-step needs of the responsibilities P."""

    support: Float[np.ndarray, "n"]
    moment: Float[np.ndarray, "n 3"]
    inlier: Float[np.ndarray, "m"]
    squared: float
    log_likelihood: float


@dataclass(frozen=True, eq=False)
class Traits:
    """Colours or normals of both clouds, divided by how much those of matching points differ."""

    source: Float[np.ndarray, "n t"]
    target: Float[np.ndarray, "m t"]


class EStep:
    """Computes expectations of one target cloud; a context manager, since it may hold threads.

    Args:
        target: (m, 3) normalised.
        source_count: n; source points must come in `spatial_order(points, BLOCK)`.
        traits: of source (in that order) and target.
        backend: "compiled", "numpy", or "auto": compiled where numba is installed.
        threads: at most this many; None takes the cores that this process may use.
    """

    def __init__(
        self,
        target: Float[np.ndarray, "m 3"],
        source_count: int,
        *,
        traits: Traits | None = None,
        backend: str = "auto",
        threads: int | None = None,
    ):
        if backend not in BACKENDS:
            raise SettingsError("is unknown", key="backend", value=backend, choices=BACKENDS)
        if backend == "auto":
            backend = "compiled" if importlib.util.find_spec("numba") else "numpy"
        self._order = spatial_order(target, GROUP)
        self._target = np.ascontiguousarray(target[self._order].T, dtype=np.float32)
        self._starts = np.arange(0, source_count, BLOCK)
        self._padding = -source_count % BLOCK
        self._traits = self._ordered_traits(traits)
        # What unlike traits can cost at most: pairs must stay in reach that only they would favour.
        self._worst_traits = 0.0
        if traits:
            self._worst_traits = float(np.square(np.ptp(np.concatenate(self._traits, axis=1), axis=1)).sum())
        self._task = self._compiled if backend == "compiled" else self._numpy
        threads = threads or _cores()
        self._pieces = max(1, min(threads, source_count * len(target) // FEWEST_PAIRS))
        self._nearest = np.full(len(target), 3e38, np.float32)  # upper bounds, squared
        self._before: Float[np.ndarray, "n 3"] | None = None
        self._pool = ThreadPoolExecutor(self._pieces - 1) if self._pieces > 1 else None

    def __enter__(self) -> "EStep":
        return self

    def __exit__(self, *_):
        if self._pool:
            self._pool.shutdown()

    def __call__(
        self, moved: Float[np.ndarray, "n 3"], variance: float, *, log_outlier: float = NO_OUTLIERS
    ) -> Expectation:
        """The expectation, given moved source points and sigma^2, both normalised."""
        moved = moved.astype(np.float32)
        boxes = np.minimum.reduceat(moved, self._starts).T, np.maximum.reduceat(moved, self._starts).T
        boxes = np.ascontiguousarray(boxes[0]), np.ascontiguousarray(boxes[1])
        self._follow(moved)
        arguments = (moved, boxes, variance, log_outlier)
        groups = -(-self._target.shape[1] // GROUP)
        cuts = [min(GROUP * (groups * i // self._pieces), self._target.shape[1]) for i in range(self._pieces)]
        ranges = list(zip(cuts, [*cuts[1:], self._target.shape[1]], strict=True))
        inlier = np.empty(self._target.shape[1])
        submit = self._pool.submit if self._pool else None
        waiting = [submit(self._task, *piece, inlier, *arguments) for piece in ranges[1:]] if submit else []
        parts = [self._task(*ranges[0], inlier, *arguments), *(future.result() for future in waiting)]
        supports, moments, squared, likelihoods = zip(*parts, strict=True)
        unordered = np.empty_like(inlier)
        unordered[self._order] = inlier
        support, moment = sum(supports[1:], supports[0]), sum(moments[1:], moments[0])
        return Expectation(support, moment, unordered, sum(squared), sum(likelihoods))

    def _follow(self, moved: Float[np.ndarray, "n 3"]):
        """Keep the bounds of the nearest distances true after the source points moved."""
        if self._before is not None:
            step = moved - self._before
            farthest = np.sqrt(np.einsum("ni,ni->n", step, step).max())
            # Rounding: float32 coordinates of a few units are good to 1e-6.
            self._nearest = np.square(np.sqrt(self._nearest) + farthest + np.float32(1e-6))
        self._before = moved

    def _reach(self, variance: float) -> float:
        return 2 * variance * (CUTOFF + self._worst_traits * np.log(2))

    def _compiled(self, first, last, inlier, moved, boxes, variance, log_outlier):
        from grasptransfer.registration.expectation_compiled import expect

        count, (low, high), (traits, moved_traits) = len(moved), boxes, self._traits
        padded = np.concatenate([moved, np.full((self._padding, 3), FAR, np.float32)])
        flat = padded.reshape(-1, BLOCK, 3).transpose(0, 2, 1).ravel()
        sums = np.zeros(4 * len(padded), np.float32)
        reach = np.float32(self._reach(variance))
        squared, likelihood = expect(
            self._target,
            first,
            last,
            flat,
            low,
            high,
            traits,
            moved_traits,
            variance,
            reach,
            log_outlier,
            sums,
            inlier,
            self._nearest,
        )
        sums = sums.reshape(-1, 4, BLOCK).transpose(0, 2, 1).reshape(-1, 4)[:count].astype(float)
        return sums[:, 0], sums[:, 1:], squared, likelihood

    def _numpy(self, first, last, inlier, moved, boxes, variance, log_outlier):
        sums = np.zeros((len(moved), 4))
        squared = likelihood = 0.0
        for start in range(first, last, CHUNK):
            chunk = slice(start, min(start + CHUNK, last))
            points = self._target[:, chunk]
            bound = self._nearest[chunk].max()
            near = self._near(points, boxes, bound, self._reach(variance), len(moved))
            measure = _by_product if variance > PRODUCT_ABOVE else _by_difference
            distance = measure(points, moved[near])
            cost = distance
            if len(self._traits[0]):
                unlike = self._traits[0][:, chunk, None] - self._traits[1][:, None, : len(moved)][:, :, near]
                cost = distance + np.float32(2 * np.log(2) * variance) * np.square(unlike).sum(0)
            self._nearest[chunk] = distance.min(1)
            least = cost.min(1)
            power = (least[:, None] - cost) * np.float32(0.5 / variance)
            np.maximum(power, -LARGEST_EXPONENT, out=power)
            np.exp(power, out=power)
            total = power.sum(1)
            log_inlier = np.log(total.astype(float)) - 0.5 * least / variance
            log_all = np.logaddexp(log_inlier, log_outlier)
            inlier[chunk] = np.exp(log_inlier - log_all)
            share = inlier[chunk] / total
            squared += float(share @ np.einsum("gn,gn->g", power, distance))
            likelihood += float(log_all.sum())
            weighted = np.concatenate([np.ones((1, points.shape[1]), np.float32), points]) * share
            sums[near] += (weighted.astype(np.float32) @ power).T
        return sums[:, 0], sums[:, 1:], squared, likelihood

    def _near(self, points, boxes, bound, reach, count):
        """Source points that matter to these targets (`_near_blocks` of the compiled kernel)."""
        low, high = points.min(1)[:, None], points.max(1)[:, None]
        gap = np.maximum(np.maximum(boxes[0] - high, low - boxes[1]), 0)
        span = np.maximum(boxes[1] - low, high - boxes[0])
        close = np.square(gap).sum(0) <= min(np.square(span).sum(0).min(), bound) + reach
        return slice(None) if close.all() else np.flatnonzero(np.repeat(close, BLOCK)[:count])

    def _ordered_traits(self, traits: Traits | None):
        """Traits as the kernel wants them: target (t, m), source (t, n), in units where 2^(-d^2)."""
        if traits is None:
            return np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32)
        scale = np.sqrt(0.5 / np.log(2))
        source = np.pad(traits.source, ((0, self._padding), (0, 0)))
        pair = traits.target[self._order], source
        return tuple(np.ascontiguousarray(side.T * scale, dtype=np.float32) for side in pair)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _by_product(
    points: Float[np.ndarray, "3 g"], moved: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "g n"]:
    """Squared distances by one matrix product; centred on the chunk, to lose few digits."""
    centre = points.mean(1)
    points, moved = points - centre[:, None], moved - centre
    ones = np.ones((1, points.shape[1]), np.float32)
    left = np.concatenate([points, np.square(points).sum(0)[None], ones])
    right = np.concatenate(
        [-2 * moved.T, np.ones((1, len(moved)), np.float32), np.square(moved).sum(1)[None]]
    )
    distance = left.T @ right
    return np.maximum(distance, 0, out=distance)


def _by_difference(
    points: Float[np.ndarray, "3 g"], moved: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "g n"]:
    """Squared distances from differences: three times slower, and exact."""
    distance = np.square(points[0][:, None] - moved[:, 0])
    for axis in (1, 2):
        difference = points[axis][:, None] - moved[:, axis]
        distance += np.square(difference, out=difference)
    return distance
