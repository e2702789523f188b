"""The Gaussian kernel and its low-rank factor, in normalised units.

| symbol | name |
| --- | --- |
| G_ij = exp(-|a_i - b_j|^2 / (2 beta^2)) | `gaussian(points_a, points_b, beta)` |
| G = L L^T, L of few columns | `pivoted_cholesky(points, beta).factor` |

Neighbouring columns of G are nearly equal, so a few dozen of them span the rest: pivoted Cholesky
picks them one by one and never forms G (Harbrecht, Peters, Schneider 2012).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

KEPT_SHARE = 0.01  # moves a registered point by 1e-5 of the size at most, as `tolerance` itself does
CHUNK_PAIRS = 100_000  # kernel entries held at once: they stay in the cache


@dataclass(frozen=True, eq=False)
class LowRankKernel:
    """G of a cloud with itself, as `factor @ factor.T`.

    Args:
        factor: (n, r) L.
        pivots: (r,) points whose columns of G span the others, in the order they were picked.
    """

    factor: Float[np.ndarray, "n r"]
    pivots: Int[np.ndarray, "r"]

    def shortest_weights(self, coefficients: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "n c"]:
        """Of all W with L^T W = coefficients the shortest: it holds nothing that G hardly shows."""
        from scipy.linalg import qr, solve_triangular

        # It holds one copy of the factor, NumPy's holds three.
        orthogonal, triangular = qr(self.factor, mode="economic")  # pyright: ignore[reportAssignmentType]
        return orthogonal @ solve_triangular(triangular, coefficients, trans=1)


@dataclass(frozen=True, eq=False)
class PrincipalKernel:
    """G of a cloud with itself, as `factor @ factor.T`, by as few columns as that takes.

    Args:
        factor: (n, r) L; its columns are orthogonal.
        strengths: (r,) their squared lengths, the eigenvalues of G.
    """

    factor: Float[np.ndarray, "n r"]
    strengths: Float[np.ndarray, "r"]

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"], beta: float, *, tolerance: float) -> "PrincipalKernel":
        """Of normalised points; no entry of G is missed by much more than `tolerance`."""
        factor = pivoted_cholesky(points, beta, tolerance=tolerance).factor
        strengths, directions = np.linalg.eigh(factor.T @ factor)
        # An eigenvector is spread over the points: each of its entries misses a small part of this.
        kept = strengths > KEPT_SHARE * tolerance * len(points)
        return cls(factor @ directions[:, kept], strengths[kept])

    def shortest_weights(self, coefficients: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "n c"]:
        """Of all W with L^T W = coefficients the shortest: it holds nothing that G hardly shows."""
        return self.factor @ (coefficients / self.strengths[:, None])


def gaussian(
    points_a: Float[np.ndarray, "m 3"], points_b: Float[np.ndarray, "n 3"], beta: float
) -> Float[np.ndarray, "m n"]:
    """Kernel between all pairs of points; (m, n), so call it on chunks."""
    exponent = (points_a / beta) @ (points_b / beta).T
    exponent -= 0.5 * np.square(points_a / beta).sum(1)[:, None]
    exponent -= 0.5 * np.square(points_b / beta).sum(1)
    np.minimum(exponent, 0.0, out=exponent)  # rounding can leave a distance below zero
    return np.exp(exponent, out=exponent)


def gaussian_times(
    points: Float[np.ndarray, "m 3"],
    centres: Float[np.ndarray, "n 3"],
    beta: float,
    columns: Float[np.ndarray, "n c"],
) -> Float[np.ndarray, "m c"]:
    """`gaussian(points, centres, beta) @ columns` with bounded memory."""
    rows = max(1, CHUNK_PAIRS // max(len(centres), 1))
    product = np.empty((len(points), columns.shape[1]))
    for start in range(0, len(points), rows):
        chunk = slice(start, start + rows)
        product[chunk] = gaussian(points[chunk], centres, beta) @ columns
    return product


def pivoted_cholesky(
    points: Float[np.ndarray, "n 3"], beta: float, *, tolerance: float = 1e-7, max_rank: int | None = None
) -> LowRankKernel:
    """Factor G column by column until no entry is missed by more than `tolerance`.

    Args:
        points: (n, 3) normalised.
        tolerance: largest error of any entry of `factor @ factor.T`; G's own entries are at most 1.
        max_rank: stop at this many columns even so.
    """
    count = len(points)
    limit = min(count, max_rank or count)
    # Transposed: each new column is contiguous. Rows that stay unused are never given memory.
    rows = np.empty((min(limit, 256), count))
    missing = np.ones(count)
    pivots: list[int] = []
    while len(pivots) < limit:
        pivot = int(np.argmax(missing))
        if missing[pivot] <= tolerance:
            break
        rank = len(pivots)
        if rank == len(rows):
            rows = np.concatenate([rows, np.empty((min(rank, limit - rank), count))])
        column = np.exp(-0.5 / beta**2 * np.square(points - points[pivot]).sum(1))
        column -= rows[:rank, pivot] @ rows[:rank]
        rows[rank] = column / np.sqrt(missing[pivot])
        missing -= np.square(rows[rank])
        missing[pivot] = 0.0
        pivots.append(pivot)
    return LowRankKernel(rows[: len(pivots)].T, np.array(pivots, dtype=int))


def weighted_ridge(
    factor: Float[np.ndarray, "n r"],
    weights: Float[np.ndarray, "n"],
    damping: float,
    right: Float[np.ndarray, "n c"],
    *,
    scratch: Float[np.ndarray, "n r"],
) -> Float[np.ndarray, "r c"]:
    """Solve (L^T diag(weights) L + damping I) c = L^T right, by Cholesky in float64.

    Args:
        factor: L, of orthogonal columns: these may be float32, each product is as good as its columns.
        weights: at least 0.
        scratch: overwritten; fresh memory of this size would cost as much as the product.
    """
    from scipy.linalg import lapack

    np.multiply(factor, np.sqrt(weights).astype(factor.dtype)[:, None], out=scratch)
    normal = (scratch.T @ scratch).astype(float)
    normal.flat[:: len(normal) + 1] += damping  # the diagonal
    moment = (factor.T @ right.astype(factor.dtype)).astype(float)
    _, solution, failed = lapack.dposv(normal, moment)  # pyright: ignore[reportAttributeAccessIssue]
    if failed:  # rounding exceeds the damping
        solution = np.linalg.lstsq(normal, moment, rcond=None)[0]
    return solution


def smoothest_weights(
    centres: Float[np.ndarray, "n 3"],
    points: Float[np.ndarray, "m 3"],
    displacements: Float[np.ndarray, "m 3"],
    *,
    beta: float,
    regularisation: float,
) -> Float[np.ndarray, "n 3"]:
    """W of the least `|G(points, centres) W - displacements|^2 + regularisation * tr(W^T G W)`.

    Args:
        centres: (n, 3) normalised.
        points: (m, 3) where the displacements are known, normalised.
        displacements: (m, 3) normalised.
    """
    from scipy.linalg import cho_factor, cho_solve, solve_triangular

    low_rank = pivoted_cholesky(centres, beta, tolerance=1e-10)
    # Features F with F F^T = G(points, points) up to the factor's tolerance; v = F c, c = L^T W.
    at_pivots = low_rank.factor[low_rank.pivots]
    normal = np.zeros((len(at_pivots),) * 2)
    moment = np.zeros((len(at_pivots), 3))
    rows = max(1, CHUNK_PAIRS // len(at_pivots))
    for start in range(0, len(points), rows):
        chunk = slice(start, start + rows)
        kernel = gaussian(centres[low_rank.pivots], points[chunk], beta)
        features = solve_triangular(at_pivots, kernel, lower=True)
        normal += features @ features.T
        moment += features @ displacements[chunk]
    normal[np.diag_indices_from(normal)] += regularisation
    coefficients = cho_solve(cho_factor(normal), moment)
    return low_rank.shortest_weights(coefficients)


def compress(
    centres: Float[np.ndarray, "n 3"], beta: float, columns: Float[np.ndarray, "n c"]
) -> tuple[Float[np.ndarray, "r 3"], Float[np.ndarray, "r c"]]:
    """Fewer centres and other columns that give the same field: `G(., centres) @ columns`.

    The field is projected on the pivots' kernels (in the kernel's own norm). It moves by less than
    1e-8 of the field within the cloud, which float64 leaves of such sums anyhow.
    """
    low_rank = pivoted_cholesky(centres, beta, tolerance=1e-11)
    if 2 * len(low_rank.pivots) > len(centres):
        return centres, columns
    from scipy.linalg import solve_triangular

    at_pivots = low_rank.factor[low_rank.pivots]  # lower triangular: G_pp = at_pivots @ at_pivots.T
    reduced = solve_triangular(at_pivots.T, low_rank.factor.T @ columns, lower=False)
    return centres[low_rank.pivots], reduced
