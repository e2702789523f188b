"""The E-step of CPD: how likely each target point came from each source point, summed up.

| symbol | name |
| --- | --- |
| P_nm | never stored |
| P 1 | `Expectation.support` |
| P X | `Expectation.moment` |
| P^T 1 | `Expectation.inlier` |
| sum P_nm |x_m - T(y_n)|^2 | `Expectation.squared` |

Two backends give the same results: a compiled loop (`expectation_compiled`), and NumPy on chunks of
pairs (`expectation_numpy`). Both skip pairs of boxes that are out of reach once sigma is small.
Source: Myronenko and Song 2010, eq. 6.
"""

import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import cores
from grasptransfer.registration.blocks import BLOCK, GROUP, spatial_order

BACKENDS = ("auto", "compiled", "numpy")
CUTOFF = 14.0  # pairs less likely by e^-14 than the nearest one do not count
FEWEST_PAIRS = 400_000  # for each thread; handing over less costs more than it saves
FAR = 1e9  # where source points that only fill up a box are put
NO_OUTLIERS = -1e30  # log of an outlier term of zero


@dataclass(frozen=True, eq=False)
class Expectation:
    """What the M-step needs of the responsibilities P, both clouds normalised.

    Args:
        support: (n,) P 1, how many target points belong to each source point.
        moment: (n, 3) P X, sum of the target points that do, each by its share.
        inlier: (m,) P^T 1, probability of each target point to belong to the source at all.
        squared: sum of P_nm |x_m - T(y_n)|^2.
        log_likelihood: log-likelihood of the target, but for a constant that EM adds.
    """

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
        traits: traits of source (in that order) and target.
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
        self._count = source_count
        self._own_traits, others = self._ordered_traits(traits)
        # Source points and their traits, one row for each coordinate; filled up to whole boxes.
        self._rows = np.zeros((3 + len(others), -(-source_count // BLOCK) * BLOCK), np.float32)
        self._rows[:3] = FAR
        self._rows[3:, :source_count] = others
        # What unlike traits can cost at most: pairs must stay in reach that only they would favour.
        self._worst_traits = 0.0
        if traits:
            both = np.concatenate([self._own_traits, others], axis=1)
            self._worst_traits = float(np.square(np.ptp(both, axis=1)).sum())
        self._compiled = backend == "compiled"
        threads = threads or cores()
        self._pieces = max(1, min(threads, source_count * len(target) // FEWEST_PAIRS))
        self._nearest = np.full(len(target), 3e38, np.float32)  # upper bounds, squared
        self._before: Float[np.ndarray, "3 n"] | None = None
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
        points = self._rows[:3, : self._count]
        points[:] = moved.T
        slots = np.ascontiguousarray(self._rows[:3].reshape(3, -1, BLOCK).transpose(2, 0, 1))
        corners = slots.min(0), slots.max(0)
        last = (self._count - 1) // BLOCK * BLOCK
        corners[1][:, -1] = points[:, last:].max(1)  # without what fills this box up
        self._follow(points)
        reach = 2 * variance * (CUTOFF + self._worst_traits * np.log(2))
        inlier = np.empty(self._target.shape[1])
        common = corners, (variance, np.float32(reach), log_outlier), (inlier, self._nearest)
        groups = -(-self._target.shape[1] // GROUP)
        cuts = [min(GROUP * (groups * i // self._pieces), self._target.shape[1]) for i in range(self._pieces)]
        ranges = list(zip(cuts, [*cuts[1:], self._target.shape[1]], strict=True))
        submit = self._pool.submit if self._pool else None
        waiting = [submit(self._task, piece, *common) for piece in ranges[1:]] if submit else []
        parts = [self._task(ranges[0], *common), *(future.result() for future in waiting)]
        sums, squared, likelihoods = zip(*parts, strict=True)
        total = reduce(np.add, sums).astype(float)
        unordered = np.empty_like(inlier)
        unordered[self._order] = inlier
        return Expectation(total[0], total[1:].T, unordered, sum(squared), sum(likelihoods))

    def _follow(self, moved: Float[np.ndarray, "3 n"]):
        """Keep the bounds of the nearest distances true after the source points moved."""
        if self._before is not None:
            step = moved - self._before
            farthest = np.sqrt(np.einsum("in,in->n", step, step).max())
            # Rounding: float32 coordinates of a few units are good to 1e-6.
            self._nearest = np.square(np.sqrt(self._nearest) + farthest + np.float32(1e-6))
        self._before = moved.copy()

    def _task(self, piece: tuple[int, int], corners, kernel, found):
        """Sums (4, n) over the targets of a piece, squared distance and log-likelihood."""
        targets = self._target, self._own_traits
        if not self._compiled:
            from grasptransfer.registration.expectation_numpy import expect

            return expect(targets, piece, self._rows[:, : self._count], corners, kernel, found)
        from grasptransfer.registration.expectation_compiled import expect

        boxes = np.ascontiguousarray(self._rows.reshape(len(self._rows), -1, BLOCK).transpose(1, 0, 2))
        sums = np.zeros((len(boxes), 4, BLOCK), np.float32)
        squared, likelihood = expect(targets, piece, boxes, corners, kernel, found, sums)
        return sums.transpose(1, 0, 2).reshape(4, -1)[:, : self._count], squared, likelihood

    def _ordered_traits(self, traits: Traits | None):
        """Traits as the kernels want them: target (t, m), source (t, n), in units where 2^(-d^2)."""
        if traits is None:
            return np.zeros((0, 0), np.float32), np.zeros((0, self._count), np.float32)
        scale = np.sqrt(0.5 / np.log(2))
        pair = traits.target[self._order], traits.source
        return tuple(np.ascontiguousarray(side.T * scale, dtype=np.float32) for side in pair)


def log_outlier_term(weight: float, variance: float, *, source: int, volume: float) -> float:
    """Log of the uniform part beside the sum of exponentials (2010, eq. 6).

    Args:
        weight: share of target points without counterpart, 0 <= w < 1.
        variance: sigma^2, normalised.
        source: number of source points.
        volume: over which points without counterpart are spread, normalised; the paper takes the number of
            target points.
    """
    if not weight:
        return NO_OUTLIERS
    odds = weight / (1 - weight) * source / volume
    return 1.5 * np.log(2 * np.pi * variance) + np.log(odds)
