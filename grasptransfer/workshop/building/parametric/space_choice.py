"""Choosing a shape space by what it leaves on shapes it never saw.

A narrow kernel follows every detail but folds space over beside thin walls, where a warped grasp
then has no meaning. So: of all kernels and smoothnesses whose held-out fields fold hardly more near
the surface than the category itself makes them (a lens that retracts folds the space it was in), the
one with the least held-out error.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from grasptransfer.registration import DeformationField, ShapeSpace
from grasptransfer.registration.kernels import gaussian

BETAS = (0.3, 0.4, 0.5, 0.7, 1.0)  # 1.5 and 2 left two to five times the error in every category
REGULARISATIONS = (0.01, 0.03, 0.1, 0.3)
MOST_MODES = 40
MODES = (8, 10, 12, 15, 20, 25, 30)
MODES_TOLERANCE = 1.05  # fewest modes whose error is within 5 % of that of `MOST_MODES`
SEARCH_SHAPES, SEARCH_POINTS = 150, 1500  # of those given: the search needs ranks, not figures
FOLD_SHAPES = 12
NEAR = 0.3  # RMS radii: how far from the surface fields must not fold (about a finger's width)
GRID = 0.16  # RMS radii: spacing of the points at which folding is measured.
SMALLEST_DETERMINANT = 0.05
FOLDED_SHARE, FOLDED_RATIO = 1e-3, 1.5  # at most this, or this much more than the candidate that folds least
_RIDGE = 1e-10  # of weights that no displacement shows


@dataclass(frozen=True)
class SpaceCandidate:
    """One kernel and smoothness, measured on held-out shapes.

    Args:
        heldout_rms: error of the surface with `MOST_MODES` modes [m].
        folded: share of the space near the surface that held-out fields turn inside out.
    """

    beta: float
    regularisation: float
    heldout_rms: float
    folded: float


@dataclass(frozen=True)
class Choice:
    """The chosen shape space.

    Args:
        space: fitted to all training shapes.
        regularisation: regularisation of the fields behind it.
        heldout_rms: RMS distance between the true surface of held-out shapes and the space's best [m].
        undeformed_rms: the same without any deformation [m].
        field_rms: the same with each shape's own field instead of the space [m].
        candidates: all that were measured.
    """

    space: ShapeSpace
    regularisation: float
    heldout_rms: float
    undeformed_rms: float
    field_rms: float
    explained: float
    candidates: tuple[SpaceCandidate, ...]

    @property
    def summary(self) -> str:
        """One line."""
        return (
            f"beta {self.space.beta:g}, lambda {self.regularisation:g}, {self.space.n_modes} modes: "
            f"held-out RMS {1000 * self.heldout_rms:.2f} mm of {1000 * self.undeformed_rms:.2f} mm"
        )

    @property
    def measured(self) -> dict[str, float]:
        """For `category.yaml`."""
        return {
            "heldout_rms_mm": round(1000 * self.heldout_rms, 4),
            "heldout_field_rms_mm": round(1000 * self.field_rms, 4),
            "heldout_undeformed_rms_mm": round(1000 * self.undeformed_rms, 4),
            "explained_variance": round(self.explained, 6),
        }


def choose_space(
    points: Float[np.ndarray, "m 3"],
    control_points: Float[np.ndarray, "n 3"],
    learnt: Float[np.ndarray, "i m 3"],
    unseen: Float[np.ndarray, "j m 3"],
) -> Choice:
    """Measure every kernel and smoothness, then fit the best to all shapes.

    Args:
        points: canonical [m].
        learnt, unseen: displacements of the points to shapes to fit and to shapes held out [m].
    """
    empty = DeformationField.identity(control_points)
    candidates = _search(points, empty, learnt, unseen)
    limit = max(FOLDED_SHARE, FOLDED_RATIO * min(one.folded for one in candidates))
    best = next(one for one in candidates if one.folded <= limit)
    most = _space(points, empty, best.beta, best.regularisation, learnt, MOST_MODES)
    enough = MODES_TOLERANCE * _encode(most, points, unseen)[1]
    for modes in (*MODES, MOST_MODES):
        space = _space(points, empty, best.beta, best.regularisation, learnt, modes)
        rms = _encode(space, points, unseen)[1]
        if rms <= enough:
            break
    weights = fit_weights(points, space, best.regularisation, unseen)
    own = _displacements(space, points, weights) - unseen
    shares = most.variances / (most.variances.sum() + most.noise_variance * (most.mean.size - MOST_MODES))
    return Choice(
        space,
        best.regularisation,
        rms,
        _rms(unseen),
        _rms(own),
        float(shares[: space.n_modes].sum()),
        tuple(candidates),
    )


def _search(points, empty: DeformationField, learnt, unseen) -> tuple[SpaceCandidate, ...]:
    """Every kernel and smoothness, the least held-out error first."""
    step = max(1, len(points) // SEARCH_POINTS)
    few, learnt, unseen = points[::step], learnt[:SEARCH_SHAPES, ::step], unseen[:, ::step]
    near = _near(points, empty.scale)
    found = []
    for beta in BETAS:
        for regularisation in REGULARISATIONS:
            # Each point stands for `step` of them, and regularisation is weighed against their sum.
            space = _space(few, empty, beta, regularisation / step, learnt, MOST_MODES)
            latents, rms = _encode(space, few, unseen)
            folded = _folded(space, latents[:FOLD_SHAPES], near)
            found.append(SpaceCandidate(beta, regularisation, rms, folded))
    return tuple(sorted(found, key=lambda one: one.heldout_rms))


def fit_weights(
    points: Float[np.ndarray, "m 3"],
    space: ShapeSpace | DeformationField,
    regularisation: float,
    displacements: Float[np.ndarray, "i m 3"],
) -> Float[np.ndarray, "i n 3"]:
    """Weights of the smoothest fields through known displacements, all at once.

    Minimises what `DeformationField.fit` minimises; only the right-hand sides differ between shapes.

    Args:
        points: (m, 3) canonical points [m].
        space: gives control points, kernel and normaliser.
        regularisation: smoothness of the fields.
        displacements: (i, m, 3) of the points to each of i shapes [m].
    """
    control = space.normaliser(space.control_points)
    kernel = gaussian(space.normaliser(points), control, space.beta)
    normal = kernel.T @ kernel + regularisation * gaussian(control, control, space.beta)
    normal[np.diag_indices_from(normal)] += _RIDGE
    count = len(displacements)
    columns = displacements.transpose(1, 0, 2).reshape(len(points), -1) / space.scale
    weights = np.linalg.solve(normal, kernel.T @ columns)
    return weights.reshape(len(control), count, 3).transpose(1, 0, 2)


def _space(points, empty: DeformationField, beta, regularisation, displacements, modes) -> ShapeSpace:
    field = DeformationField(empty.control_points, empty.weights, beta, empty.centre, empty.scale)
    weights = fit_weights(points, field, regularisation, displacements)
    return ShapeSpace.fit(
        weights, field.control_points, beta, field.centre, field.scale, n_modes=modes, metric="GW"
    )


def _encode(space: ShapeSpace, points, displacements) -> tuple[Float[np.ndarray, "j k"], float]:
    """Least-squares latents of known displacements, and the RMS distance they leave [m]."""
    model = space.displacement_model(points)
    design = model.basis.reshape(-1, space.n_modes)
    offsets = (displacements - model.mean).reshape(len(displacements), -1)
    latents = np.linalg.lstsq(design, offsets.T, rcond=None)[0].T
    return latents, _rms((offsets - latents @ design.T).reshape(displacements.shape))


def _displacements(space: ShapeSpace, points, weights) -> Float[np.ndarray, "j m 3"]:
    kernel = gaussian(space.normaliser(points), space.normaliser(space.control_points), space.beta)
    return space.scale * np.einsum("mn,jnc->jmc", kernel, weights, optimize=True)


def _rms(differences: Float[np.ndarray, "j m 3"]) -> float:
    return float(np.sqrt(np.square(differences).sum(-1).mean()))


def _near(points, scale: float) -> Float[np.ndarray, "q 3"]:
    """Grid points around the surface [m]."""
    low, high = points.min(0) - NEAR * scale, points.max(0) + NEAR * scale
    axes = [np.arange(start, stop, GRID * scale) for start, stop in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return grid[KDTree(points).query(grid)[0] < NEAR * scale]


def _folded(space: ShapeSpace, latents, near) -> float:
    """Share of the points `near` whose neighbourhood the fields turn inside out, or nearly."""
    shares = [
        (np.linalg.det(space.field(latent).jacobian(near)) < SMALLEST_DETERMINANT).mean()
        for latent in latents
    ]
    return float(np.mean(shares))
