"""Shape spaces: the fields of a category as a few latent numbers, W = mean + sum_k x_k basis_k.

| symbol | name | unit |
| --- | --- | --- |
| x ~ N(0, I) | `latent` (k,) | standard deviations |
| Lambda | `basis` (k, n, 3), each mode one standard deviation long | normalised |
| w mean | `mean` (n, 3) | normalised |
| delta = D G (Lambda x + w) | `displacement_model(points)` | m |

Source: Rodriguez, Huber, Behnke 2020, section III-B (PCA-EM) and eq. 13 (least squares for x); the
posterior is that of probabilistic PCA (Tipping and Bishop 1999).
"""

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.errors import PointCloudError, SettingsError
from grasptransfer.registration.clouds import Normaliser, check_points
from grasptransfer.registration.displacement_model import DisplacementModel
from grasptransfer.registration.field import DeformationField, positive
from grasptransfer.registration.field_metric import METRICS, FieldMetric, Metric
from grasptransfer.registration.kernels import compress, gaussian_times
from grasptransfer.registration.posterior import LatentPosterior, SpaceScore
from grasptransfer.registration.ppca import count_modes, fit_closed, fit_em
from grasptransfer.registration.storage import load_arrays, save_arrays

KIND = "shape space"


@dataclass(frozen=True, eq=False)
class EmSettings:
    """How a shape space is learnt by expectation maximisation.

    Args:
        observed: (i, n) which control points of each instance to believe; None believes all of them.
        seed: seed of the first guess.
    """

    observed: Bool[np.ndarray, "i n"] | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """Linear Gaussian model of a category's fields.

    Args:
        control_points: (n, 3) canonical [m].
        beta: kernel width, normalised units.
        centre: (3,) centre of the normaliser [m].
        scale: scale of the normaliser [m].
        mean: (n, 3) weights of the mean shape, normalised.
        basis: (k, n, 3) weights of each mode at one standard deviation, normalised.
        variances: (k,) variance of the training data along each mode, in the metric.
        noise_variance: variance per coordinate of what the modes leave out, in the metric.
        metric: the metric in which PCA measured the fields: "GW", "G" or "W".
    """

    control_points: Float[np.ndarray, "n 3"]
    beta: float
    centre: Float[np.ndarray, "3"]
    scale: float
    mean: Float[np.ndarray, "n 3"]
    basis: Float[np.ndarray, "k n 3"]
    variances: Float[np.ndarray, "k"]
    noise_variance: float
    metric: Metric = "GW"

    def __post_init__(self):
        if self.metric not in METRICS:
            raise SettingsError("is unknown", key="metric", value=self.metric, choices=METRICS)
        for name in ("control_points", "centre", "mean", "basis", "variances"):
            array = np.array(getattr(self, name), dtype=float)
            if not np.isfinite(array).all():
                raise PointCloudError("holds NaN or infinity", key=name)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        points = self.control_points.shape
        modes = len(self.variances)
        if self.mean.shape != points or self.basis.shape != (modes, *points):
            raise PointCloudError(
                f"mean must be {points} and basis {(modes, *points)}", key="basis", value=self.basis.shape
            )
        for name in ("beta", "scale"):
            object.__setattr__(self, name, positive(getattr(self, name), name))
        object.__setattr__(self, "noise_variance", float(self.noise_variance))

    @classmethod
    def fit(
        cls,
        weights: Float[np.ndarray, "i n 3"],
        control_points: Float[np.ndarray, "n 3"],
        beta: float,
        centre: Float[np.ndarray, "3"],
        scale: float,
        *,
        n_modes: int | None = None,
        metric: Metric = "GW",
        em: EmSettings | None = None,
    ) -> "ShapeSpace":
        """Learn the space from the fields of the training instances.

        Args:
            weights: (i, n, 3) weights of the fields of the instances, normalised units.
            control_points: (n, 3) control points that all of them share, canonical [m].
            beta, centre, scale: kernel width and normaliser that all of them share.
            n_modes: k; at most i - 1. None takes the fewest that hold 99 % of the variance.
            metric: what the modes should explain: displacements "GW", bending "G", weights "W".
            em: learn by EM, as the paper does; None takes the closed form.

        Raises:
            SettingsError: an unknown metric, more modes than instances allow, or gaps with metric "G".
            PointCloudError: weights of the wrong shape or not finite.
        """
        mean = np.zeros(np.shape(weights)[1:])
        empty = cls(control_points, beta, centre, scale, mean, mean[None][:0], np.zeros(0), 0.0, metric)
        observed = None if em is None else em.observed
        weights = _check_weights(weights, observed)
        if observed is not None and metric == "G":
            raise SettingsError('needs metric "GW" or "W"', key="observed")
        features = np.stack([empty._measure.features(one).ravel() for one in weights])
        n_modes = count_modes(features, n_modes)
        if em is None:
            found = fit_closed(features, n_modes)
            mean = weights.mean(0)
            basis = np.einsum("ki,inc->knc", found.combinations, weights - mean)
        else:
            seen = None if observed is None else np.repeat(observed, 3, axis=1)
            found = fit_em(features, n_modes, observed=seen, seed=em.seed)
            # Features with gaps need not be those of any smooth field.
            rough = 0.0 if observed is None else found.noise_variance
            mean = empty._measure.weights_of(found.mean, rough)
            basis = np.stack([empty._measure.weights_of(mode, rough) for mode in found.loading])
        learnt = {"variances": found.variances, "noise_variance": found.noise_variance}
        return dataclasses.replace(empty, mean=mean, basis=basis, **learnt)

    @property
    def n_modes(self) -> int:
        """k."""
        return len(self.basis)

    @property
    def normaliser(self) -> Normaliser:
        """From metres to the units of beta and the weights."""
        return Normaliser(self.centre, self.scale)

    def field(self, latent: Float[np.ndarray, "k"] | None = None) -> DeformationField:
        """The field of a latent [standard deviations]; of the mean shape without one.

        Raises:
            SettingsError: not k finite numbers.
        """
        weights = self.mean if latent is None else self.decode(latent)
        return DeformationField(self.control_points, weights, self.beta, self.centre, self.scale)

    def decode(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "n 3"]:
        """Weights W [normalised] of a latent.

        Raises:
            SettingsError: not k finite numbers.
        """
        return self.mean + np.tensordot(self._check_latent(latent), self.basis, axes=1)

    def encode(self, weights: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k"]:
        """The most likely latent of a field's weights [normalised], under the space's own noise.

        Raises:
            PointCloudError: weights that are not (n, 3) or not finite.
        """
        features = self._measure.features(check_points(weights, "weights") - self.mean).ravel()
        precision = self._basis_features @ self._basis_features.T
        # A space without noise still needs a solvable system: rounding only.
        damping = max(self.noise_variance, 1e-14 * np.trace(precision) / max(self.n_modes, 1), 1e-300)
        return np.linalg.solve(precision + damping * np.eye(self.n_modes), self._basis_features @ features)

    def interpolate(
        self, latent_a: Float[np.ndarray, "k"], latent_b: Float[np.ndarray, "k"], share: float
    ) -> DeformationField:
        """The field between two shapes, or beyond them: `share` 0 is a, 1 is b.

        Raises:
            SettingsError: a latent that is not k finite numbers.
        """
        a, b = self._check_latent(latent_a), self._check_latent(latent_b)
        return self.field(a + share * (b - a))

    def sample(self, rng: np.random.Generator) -> Float[np.ndarray, "k"]:
        """A random latent of the category."""
        return rng.normal(size=self.n_modes)

    def displacement_model(self, points: Float[np.ndarray, "m 3"]) -> DisplacementModel:
        """The displacement at canonical points as a linear function of the latent.

        Args:
            points: (m, 3) canonical frame [m].

        Raises:
            PointCloudError: points that are not (m, 3) or not finite.
        """
        points = check_points(points, "points")
        centres, columns = self._carriers
        moved = gaussian_times(self.normaliser(points), centres, self.beta, columns)
        moved *= self.scale
        moved = moved.reshape(len(points), 3, 1 + self.n_modes)
        return DisplacementModel(moved[:, :, 0], moved[:, :, 1:])

    def map_estimate(
        self,
        points_canonical: Float[np.ndarray, "m 3"],
        displacements: Float[np.ndarray, "m 3"],
        noise_std: Float[np.ndarray, "m"] | float,
    ) -> LatentPosterior:
        """The most likely latent under the prior, of displacements seen at some points (eq. 13).

        Args:
            points_canonical: (m, 3) where they were seen [m].
            displacements: (m, 3) [m].
            noise_std: standard deviation of their errors, per coordinate [m].

        Raises:
            PointCloudError: not finite, or unequal lengths.
            SettingsError: a noise that is not positive.
        """
        displacements = check_points(displacements, "displacements")
        model = self.displacement_model(points_canonical)
        if len(model) != len(displacements):
            raise PointCloudError(
                f"{len(model)} points need as many displacements",
                key="displacements",
                value=len(displacements),
            )
        return LatentPosterior.of(model, displacements, noise_std)

    def score(self, weights: Float[np.ndarray, "n 3"]) -> SpaceScore:
        """How well a field's weights [normalised] belong to the category; large values are strangers."""
        latent = self.encode(weights)
        left = DeformationField(
            self.control_points, weights - self.decode(latent), self.beta, self.centre, self.scale
        ).displacement(self.control_points)
        mahalanobis = float(np.sqrt(np.square(latent).mean())) if len(latent) else 0.0
        return SpaceScore(mahalanobis, float(np.sqrt(np.square(left).sum(1).mean())))

    def save(self, path: str | Path):
        """Write the space as npz with a checksum."""
        save_arrays(path, KIND, {f.name: np.asarray(getattr(self, f.name)) for f in dataclasses.fields(self)})

    @classmethod
    def load(cls, path: str | Path) -> "ShapeSpace":
        """Read a space that `save` wrote.

        Raises:
            FieldFileError: missing, corrupt or not a shape space.
        """
        data = load_arrays(path, KIND)
        plain = {name: data[name].item() for name in ("beta", "scale", "noise_variance", "metric")}
        return cls(**{**data, **plain})

    @cached_property
    def _carriers(self):
        """Centres (r, 3) and columns (r, 3 (1 + k)), coordinate-major, of mean and basis together."""
        columns = np.concatenate([self.mean[None], self.basis]).transpose(1, 2, 0)
        return compress(
            self.normaliser(self.control_points), self.beta, columns.reshape(len(self.control_points), -1)
        )

    @cached_property
    def _measure(self) -> FieldMetric:
        return FieldMetric(self.metric, self.normaliser(self.control_points), self.beta)

    @cached_property
    def _basis_features(self) -> Float[np.ndarray, "k d"]:
        size = self._measure.features(self.mean).size
        return np.array([self._measure.features(mode).ravel() for mode in self.basis]).reshape(
            self.n_modes, size
        )

    def _check_latent(self, latent) -> Float[np.ndarray, "k"]:
        latent = np.asarray(latent, dtype=float)
        if latent.shape != (self.n_modes,) or not np.isfinite(latent).all():
            raise SettingsError(f"must be {self.n_modes} finite numbers", key="latent", value=latent.tolist())
        return latent


def _check_weights(weights, observed) -> Float[np.ndarray, "i n 3"]:
    weights = np.asarray(weights, dtype=float)
    if weights.ndim != 3 or weights.shape[2] != 3 or len(weights) < 2:
        raise PointCloudError("must be (i, n, 3) of at least 2 instances", key="weights", value=weights.shape)
    if observed is not None and observed.shape != weights.shape[:2]:
        raise PointCloudError(f"must be {weights.shape[:2]}", key="observed", value=observed.shape)
    if not np.isfinite(weights).all():
        raise PointCloudError("holds NaN or infinity", key="weights")
    return weights
