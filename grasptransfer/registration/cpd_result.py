"""What CPD returns: the field, how the registration went, and a summary of who belongs to whom."""

import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import transform_points
from grasptransfer.registration.field import DeformationField


class CpdStatus(enum.Enum):
    """Outcome of a registration; `advice` says what to do about it."""

    CONVERGED = "converged"
    VARIANCE_FLOOR = "variance_floor"
    ITERATION_LIMIT = "iteration_limit"
    STOPPED = "stopped"

    @property
    def advice(self) -> str:
        """One sentence for the user."""
        return {
            CpdStatus.CONVERGED: "The variance settled: the field can be used.",
            CpdStatus.VARIANCE_FLOOR: "The clouds coincide as far as float32 shows: the field can be used.",
            CpdStatus.ITERATION_LIMIT: (
                "The variance was still changing at the iteration limit: raise max_iterations or tolerance."
            ),
            CpdStatus.STOPPED: "The callback asked to stop: the field is that of the last iteration.",
        }[self]


@dataclass(frozen=True, eq=False)
class CpdProgress:
    """What a callback is given after each iteration.

    Args:
        iteration: number of the iteration, from 1.
        moved: (n, 3) source points where they are now, source frame [m].
        variance: sigma^2 [m^2].
        objective: penalised negative log-likelihood before this iteration's M-step.
    """

    iteration: int
    moved: Float[np.ndarray, "n 3"]
    variance: float
    objective: float


@dataclass(frozen=True, eq=False)
class CpdResult:
    """A registration of a source to a target.

    Args:
        field: field from the source to the (aligned) target [m].
        status: outcome, with advice.
        iterations: number of iterations of EM.
        variance: sigma^2 at the end [m^2].
        variance_floor: least value that sigma^2 was allowed [m^2].
        objective_history: penalised negative log-likelihood before each M-step; never rises.
        source_support: (n,) how many target points belong to each source point.
        target_inlier: (m,) probability of each target point to belong to the source at all.
        matched_targets: (n, 3) mean of the target points that belong to each source point, source frame [m].
        outlier_weight: share of target points without counterpart, as given or estimated.
        target_from_source: (4, 4) affine pre-alignment; the identity without.
    """

    field: DeformationField
    status: CpdStatus
    iterations: int
    variance: float
    variance_floor: float
    objective_history: tuple[float, ...]
    source_support: Float[np.ndarray, "n"]
    target_inlier: Float[np.ndarray, "m"]
    matched_targets: Float[np.ndarray, "n 3"]
    outlier_weight: float
    target_from_source: Float[np.ndarray, "4 4"]

    def __call__(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points of the source's frame on the target, in the target's frame [m]."""
        return transform_points(self.target_from_source, self.field(points))
