"""From registered instances to a shape space, and what it leaves of an instance it never saw."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from grasptransfer.errors import SettingsError
from grasptransfer.registration import DeformationField, Metric, ShapeSpace, latent_fit
from grasptransfer.registration.kernels import gaussian

FEWEST = 3  # A shape space needs at least so many instances.
SMOOTH = 12  # smooth displacements along each axis, where a space is loosened


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
        there = KDTree(model).query(instance)[0]
        back = KDTree(instance).query(model)[0]
        error = float(np.square(there).mean())
        return Distances(error, float(np.sqrt(error)), float((there.mean() + back.mean()) / 2))


@dataclass(frozen=True, eq=False)
class InstanceFields:
    """The fields from one canonical model to several instances, which differ in their weights alone.

    Args:
        weights: (i, n, 3) of each instance's field, normalised units.
        control_points: (n, 3) of the canonical model [m].
        beta: kernel width, normalised units.
        centre: (3,) of the normaliser [m].
        scale: scale of the normaliser [m].
    """

    weights: Float[np.ndarray, "i n 3"]
    control_points: Float[np.ndarray, "n 3"]
    beta: float
    centre: Float[np.ndarray, "3"]
    scale: float

    def __len__(self) -> int:
        return len(self.weights)

    def field(self, index: int) -> DeformationField:
        """The field to one instance."""
        return DeformationField(self.control_points, self.weights[index], self.beta, self.centre, self.scale)

    def without(self, index: int) -> "InstanceFields":
        """Those to all instances but one."""
        return dataclasses.replace(self, weights=np.delete(self.weights, index, axis=0))


@dataclass(frozen=True)
class LeftOut:
    """One instance explained by the shape space of all the others.

    Args:
        space: shape space of the other instances.
        rms: distance between the control points on the instance's own field and on the space's best [m].
    """

    space: ShapeSpace
    rms: float


def leave_out(
    fields: InstanceFields, index: int, *, n_modes: int, flexibility: float, metric: Metric
) -> LeftOut:
    """Fit a shape space to all instances but one, and explain the field of this instance by the space.

    Args:
        index: number of the instance that is left out.
        n_modes: learnt from the others.
        flexibility: see `loosened`.
    """
    space = loosened(fit_space(fields.without(index), n_modes=n_modes, metric=metric), flexibility)
    own, found = fields.field(index), space.field(space.encode(fields.weights[index]))
    points = fields.control_points
    return LeftOut(space, float(np.sqrt(np.square(own(points) - found(points)).sum(1).mean())))


def fitted_error(
    space: ShapeSpace,
    observed: Float[np.ndarray, "m 3"],
    *,
    model: Float[np.ndarray, "p 3"] | None = None,
    measured: Float[np.ndarray, "q 3"] | None = None,
) -> float:
    """E of the shape that the space takes when it is fitted to a cloud whose field is unknown (CLS) [m^2].

    Args:
        observed: points to fit to [m].
        model: points of the canonical model to measure from; the control points by default [m].
        measured: points of the instance to measure at; the observed ones by default [m].
    """
    model = space.control_points if model is None else model
    found = space.field(latent_fit(space, observed).latent)
    return Distances.between(found(model), observed if measured is None else measured).error


def fit_space(fields: InstanceFields, *, n_modes: int | None, metric: Metric) -> ShapeSpace:
    """The shape space of the instances.

    Args:
        n_modes: None takes the fewest that hold 99 % of the variance.

    Raises:
        SettingsError: more modes than the instances allow.
    """
    most = len(fields) - 1
    if n_modes is not None and n_modes > most:
        raise SettingsError(f"{len(fields)} instances allow {most} at most", key="modes", value=n_modes)
    return ShapeSpace.fit(
        fields.weights,
        fields.control_points,
        fields.beta,
        fields.centre,
        fields.scale,
        n_modes=n_modes,
        metric=metric,
    )


def loosened(space: ShapeSpace, flexibility: float) -> ShapeSpace:
    """The space with smooth modes beside the learnt ones, for what few instances cannot show.

    Args:
        space: as it was learnt.
        flexibility: standard deviation of the displacement that they add along each axis, in RMS radii; with
            0 the space stays as it is.

    Source: Luethi, Gerig, Jud, Vetter, Gaussian Process Morphable Models, 2018 (sum of a learnt and a
    smooth kernel); the smooth displacements are the first principal components of the space's own kernel.
    """
    if not flexibility:
        return space
    points = space.normaliser(space.control_points)
    count = len(points)
    values, vectors = np.linalg.eigh(gaussian(points, points, space.beta))
    values, vectors = values[: -SMOOTH - 1 : -1], vectors[:, : -SMOOTH - 1 : -1]
    # The variance is summed over the control points.
    variances = count * flexibility**2 * values / values.sum()
    weights = np.einsum("nr,ij->rinj", vectors * (np.sqrt(variances) / values), np.eye(3))
    return dataclasses.replace(
        space,
        basis=np.concatenate([space.basis, weights.reshape(-1, count, 3)]),
        variances=np.concatenate([space.variances, np.repeat(variances, 3)]),
    )


def explained_variance(fields: InstanceFields, *, metric: Metric) -> Float[np.ndarray, "k"]:
    """Share of the variance that the first modes hold together, for one mode and more."""
    variances = fit_space(fields, n_modes=len(fields) - 1, metric=metric).variances
    return np.cumsum(variances) / max(float(variances.sum()), 1e-300)
