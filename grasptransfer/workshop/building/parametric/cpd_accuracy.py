"""How near CPD comes to the true correspondences, which parametric shapes have and scans do not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from grasptransfer.registration import PreparedSource, cpd
from grasptransfer.workshop.building.parametric.canonical_surface import CanonicalPoints
from grasptransfer.workshop.building.surface_points import visible_surface
from grasptransfer.workshop.building.tasks import TARGET_POINTS, thinned
from grasptransfer.workshop.objects import sample

BETAS = (1.0, 2.0, 5.0)
LAMBDAS = (3.0, 30.0, 100.0, 300.0, 1000.0)
FIRST_SEED = 3_000_000


@dataclass(frozen=True)
class CpdAccuracy:
    """Distance between where CPD puts canonical points and where they truly are, over several samples.

    Args:
        beta, lam: settings of CPD.
        mean, p95: mean and 95th percentile [m].
        mean_share, p95_share: the same as a share of each sample's diagonal.
        surface_rms: RMS distance from the samples' points to the nearest deformed point [m]; small even
            where points slid along the surface.
    """

    beta: float
    lam: float
    mean: float
    p95: float
    mean_share: float
    p95_share: float
    surface_rms: float


def cpd_accuracy(
    surface: CanonicalPoints,
    *,
    betas: Sequence[float] = BETAS,
    lambdas: Sequence[float] = LAMBDAS,
    samples: int = 10,
) -> list[CpdAccuracy]:
    """Register the canonical control points to clouds of random samples, with each pair of settings.

    Args:
        surface: points of the canonical model.
        betas: kernel widths to try, normalised units.
        lambdas: smoothnesses to try.
        samples: number of random shapes.

    Returns:
        one for each pair, the least mean error first.
    """
    chosen = KDTree(surface.points).query(surface.control_points)[1]
    source = surface.points[chosen]
    drawn = [sample(surface.model.category, FIRST_SEED + index) for index in range(samples)]
    truths = [surface.on(shape)[chosen] for shape in drawn]
    clouds = [thinned(visible_surface(shape.mesh())[0], TARGET_POINTS) for shape in drawn]
    sizes = [float(np.linalg.norm(np.ptp(shape.vertices, axis=0))) for shape in drawn]
    rows = []
    for beta in betas:
        prepared = PreparedSource(source, beta=beta)
        for lam in lambdas:
            moved = [cpd(prepared, cloud, lam=lam, threads=1).field(source) for cloud in clouds]
            errors = [np.linalg.norm(a - b, axis=1) for a, b in zip(moved, truths, strict=True)]
            shares = [error / size for error, size in zip(errors, sizes, strict=True)]
            gaps = [np.square(KDTree(a).query(b)[0]).mean() for a, b in zip(moved, clouds, strict=True)]
            mean, p95 = _figures(errors)
            rows.append(CpdAccuracy(beta, lam, mean, p95, *_figures(shares), float(np.sqrt(np.mean(gaps)))))
    return sorted(rows, key=lambda row: row.mean)


def _figures(values: list[np.ndarray]) -> tuple[float, float]:
    everything = np.concatenate(values)
    return float(everything.mean()), float(np.percentile(everything, 95))
