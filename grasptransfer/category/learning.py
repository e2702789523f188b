"""From registered instances to a shape space: how many modes, and what they leave of an unseen instance."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from grasptransfer.errors import SettingsError
from grasptransfer.registration import DeformationField, ShapeSpace

FEWEST = 3  # instances behind a shape space
TRIED_MODES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30)
TOLERANCE = 1.02  # fewest modes within 2 % of the least leave-one-out error,
NEGLIGIBLE = 0.005  # not counting half a percent of the error without any mode


@dataclass(frozen=True)
class Distances:
    """How far a deformed canonical model and an instance are apart.

    Args:
        error: E, mean squared distance from the instance's points to the model's [m^2].
        rms: its root [m].
        chamfer: mean distance, both ways averaged [m].
    """

    error: float
    rms: float
    chamfer: float

    @staticmethod
    def between(model: Float[np.ndarray, "n 3"], instance: Float[np.ndarray, "m 3"]) -> "Distances":
        """Of two clouds [m]."""
        there = cKDTree(model).query(instance)[0]
        back = cKDTree(instance).query(model)[0]
        error = float(np.square(there).mean())
        return Distances(error, float(np.sqrt(error)), float((there.mean() + back.mean()) / 2))


@dataclass(frozen=True)
class LeftOut:
    """Each instance explained by the shape space of all the others.

    Args:
        rms: (i,) distance between the control points on its own field and on the space's best [m].
        fields: of the space's best, in the same order.
    """

    rms: Float[np.ndarray, "i"]
    fields: tuple[DeformationField, ...]

    @property
    def overall(self) -> float:
        """RMS over all instances [m]."""
        return float(np.sqrt(np.square(self.rms).mean()))


def leave_one_out(
    weights: Float[np.ndarray, "i n 3"], field: DeformationField, *, n_modes: int, metric: str
) -> LeftOut:
    """Fit a shape space to all instances but one, and explain that one by it; in turn.

    Args:
        weights: of each instance's field, normalised units.
        field: any field with the control points, kernel and normaliser of them all.
    """
    rms, fields = [], []
    for index in range(len(weights)):
        space = fit_space(np.delete(weights, index, axis=0), field, n_modes=n_modes, metric=metric)
        found = space.field(space.encode(weights[index]))
        own = dataclasses.replace(space.field(), weights=weights[index])
        points = own.control_points
        rms.append(np.sqrt(np.square(own(points) - found(points)).sum(1).mean()))
        fields.append(found)
    return LeftOut(np.array(rms), tuple(fields))


def choose_modes(weights: Float[np.ndarray, "i n 3"], field: DeformationField, *, metric: str) -> int:
    """The fewest modes that explain an unseen instance nearly as well as any number does."""
    most = len(weights) - 2
    tried = [modes for modes in TRIED_MODES if modes <= most] or [1]
    errors = [leave_one_out(weights, field, n_modes=modes, metric=metric).overall for modes in tried]
    deviations = weights - weights.mean(0)
    moved = [dataclasses.replace(field, weights=one).displacement(field.control_points) for one in deviations]
    without = float(np.sqrt(np.square(moved).sum(-1).mean()))
    enough = TOLERANCE * min(errors) + NEGLIGIBLE * without
    return next(modes for modes, error in zip(tried, errors, strict=True) if error <= enough)


def fit_space(
    weights: Float[np.ndarray, "i n 3"], field: DeformationField, *, n_modes: int | None, metric: str
) -> ShapeSpace:
    """The shape space of fields that share the control points, kernel and normaliser of `field`.

    Raises:
        SettingsError: more modes than the instances allow.
    """
    most = len(weights) - 1
    if n_modes is not None and n_modes > most:
        raise SettingsError(f"{len(weights)} instances allow {most} at most", key="modes", value=n_modes)
    return ShapeSpace.fit(
        weights,
        field.control_points,
        field.beta,
        field.centre,
        field.scale,
        n_modes=n_modes,
        metric=metric,  # pyright: ignore[reportArgumentType]  checked by ShapeSpace
    )


def explained_variance(
    weights: Float[np.ndarray, "i n 3"], field: DeformationField, *, metric: str
) -> Float[np.ndarray, "k"]:
    """Share of the variance that the first modes hold together, for one mode and more."""
    variances = fit_space(weights, field, n_modes=len(weights) - 1, metric=metric).variances
    return np.cumsum(variances) / max(float(variances.sum()), 1e-300)
