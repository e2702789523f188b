"""Deformation fields: v(Z) = s G((Z - c) / s, (C - c) / s) W, a smooth displacement anywhere in space.

| symbol | name | unit |
| --- | --- | --- |
| C | `control_points` (n, 3) | m |
| W | `weights` (n, 3) | normalised |
| G_ij = exp(-|a_i - b_j|^2 / (2 beta^2)) | `kernels.gaussian` | |
| beta | `beta`, width of the kernel | normalised |
| c, s | `centre`, `scale`: the normaliser | m |
| T(Z) = Z + v(Z) | `field(points)` | m |
| J = I + dv/dZ | `field.jacobian(points)` | |

Source: Myronenko and Song, Point Set Registration: Coherent Point Drift, 2010, section 5; Rodriguez,
Huber, Behnke, Category-Level 3D Non-Rigid Registration from Single-View RGB Images, 2020, eq. 1-3.
"""

import dataclasses
import logging
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import PointCloudError, SettingsError
from grasptransfer.registration.clouds import Normaliser, check_cloud, check_points
from grasptransfer.registration.kernels import compress, gaussian_times, smoothest_weights
from grasptransfer.registration.storage import load_arrays, save_arrays

logger = logging.getLogger(__name__)

KIND = "deformation field"
COMPRESS_ABOVE = 4_000_000  # pairs of points and control points; below, compressing does not pay
INVERSE_ITERATIONS = 40


@dataclass(frozen=True, eq=False)
class DeformationField:
    """A smooth displacement of space, carried by weights at control points.

    Args:
        control_points: (n, 3) C, canonical frame [m].
        weights: (n, 3) W, normalised units.
        beta: width of the Gaussian kernel, normalised units.
        centre: (3,) of the normaliser, canonical frame [m].
        scale: scale of the normaliser, usually the RMS radius of the control points [m].

    Raises:
        PointCloudError: arrays of the wrong shape or not finite.
        SettingsError: beta or scale not positive.
    """

    control_points: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n 3"]
    beta: float
    centre: Float[np.ndarray, "3"]
    scale: float

    def __post_init__(self):
        arrays = {
            "control_points": check_points(self.control_points, "control_points"),
            "weights": check_points(self.weights, "weights"),
            "centre": check_points(np.asarray(self.centre).reshape(1, -1), "centre")[0],
        }
        if len(arrays["weights"]) != len(arrays["control_points"]):
            raise PointCloudError(
                f"there must be one weight for each of the {len(arrays['control_points'])} control points",
                key="weights",
                value=arrays["weights"].shape,
            )
        for name, array in arrays.items():
            if array.flags.writeable:  # a copy, so that nobody's array is locked
                array = array.copy()
                array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in ("beta", "scale"):
            object.__setattr__(self, name, positive(getattr(self, name), name))

    @classmethod
    def identity(
        cls,
        control_points: Float[np.ndarray, "n 3"],
        *,
        beta: float = 2.0,
        centre: Float[np.ndarray, "3"] | None = None,
        scale: float | None = None,
    ) -> "DeformationField":
        """The field that moves nothing.

        Args:
            control_points: (n, 3) [m].
            beta: width of the kernel, normalised units.
            centre, scale: normaliser [m]; the control points' own by default.

        Raises:
            PointCloudError: a cloud that is not (n, 3), not finite or without extent.
            SettingsError: beta or scale not positive.
        """
        points = check_cloud(control_points, "control_points")
        own = Normaliser.of(points)
        centre = own.centre if centre is None else centre
        return cls(points, np.zeros_like(points), beta, centre, own.scale if scale is None else scale)

    @classmethod
    def fit(
        cls,
        control_points: Float[np.ndarray, "n 3"],
        points: Float[np.ndarray, "m 3"],
        targets: Float[np.ndarray, "m 3"],
        *,
        beta: float = 2.0,
        regularisation: float = 1e-6,
        centre: Float[np.ndarray, "3"] | None = None,
        scale: float | None = None,
    ) -> "DeformationField":
        """The smoothest field that takes known points to known targets, by least squares.

        Minimises `|v(points) - (targets - points)|^2 + regularisation * tr(W^T G W)`, in normalised
        units: CPD's M-step with certain correspondences (Myronenko and Song 2010, eq. 22).

        Args:
            control_points: (n, 3) [m].
            points: (m, 3) canonical points [m], the control points or any others.
            targets: (m, 3) where they belong [m].
            beta: width of the kernel, normalised units.
            regularisation: larger is smoother; 1e-9 nearly interpolates.
            centre, scale: normaliser [m]; the control points' own by default.

        Raises:
            PointCloudError: clouds of unequal length, not finite or without extent.
            SettingsError: beta, regularisation or scale not positive.
        """
        field = cls.identity(control_points, beta=beta, centre=centre, scale=scale)
        points, targets = check_points(points, "points", fewest=1), check_points(targets, "targets")
        if len(points) != len(targets):
            raise PointCloudError(
                f"{len(points)} points need as many targets", key="targets", value=len(targets)
            )
        regularisation = positive(regularisation, "regularisation")
        weights = smoothest_weights(
            field.normaliser(field.control_points),
            field.normaliser(points),
            (targets - points) / field.scale,
            beta=field.beta,
            regularisation=regularisation,
        )
        return dataclasses.replace(field, weights=weights)

    def __call__(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Warped points Z + v(Z) [m] of canonical points [m]."""
        points = check_points(points, "points")
        return points + self.displacement(points)

    def displacement(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """v(Z) [m] at canonical points [m]."""
        points = check_points(points, "points")
        centres, weights = self._carriers(len(points))
        return self.scale * gaussian_times(self.normaliser(points), centres, self.beta, weights)

    def jacobian(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3 3"]:
        """J = I + dv/dZ at canonical points [m]: how a small neighbourhood turns and stretches."""
        normalised = self.normaliser(check_points(points, "points"))
        centres, weights = self._carriers(4 * len(normalised))
        # dG/dz = -G (z - c) / beta^2: both terms in one product with [W, W c^T].
        outer = (weights[:, :, None] * centres[:, None, :]).reshape(-1, 9)
        product = gaussian_times(normalised, centres, self.beta, np.hstack([weights, outer]))
        gradient = product[:, 3:].reshape(-1, 3, 3) - product[:, :3, None] * normalised[:, None, :]
        return np.eye(3) + gradient / self.beta**2

    def inverse(
        self, points: Float[np.ndarray, "m 3"], *, tolerance: float | None = None
    ) -> Float[np.ndarray, "m 3"]:
        """Canonical points [m] that the field takes to these points [m], by damped Newton steps.

        Where the field folds, the nearest miss is returned, and a warning logged.

        Args:
            points: (m, 3) warped points [m].
            tolerance: accepted distance [m]; 1e-7 of the field's scale by default.
        """
        points = check_points(points, "points")
        tolerance = 1e-7 * self.scale if tolerance is None else positive(tolerance, "tolerance")
        found = points - self.displacement(points)
        miss = self(found) - points
        for _ in range(INVERSE_ITERATIONS):
            open_ = np.flatnonzero(np.linalg.norm(miss, axis=1) > tolerance)
            if not len(open_):
                return found
            jacobian = self.jacobian(found[open_])
            # Levenberg's damping keeps the step finite where the field folds (det J = 0).
            damping = 1e-9 * np.eye(3)
            transposed = jacobian.transpose(0, 2, 1)
            step = np.linalg.solve(transposed @ jacobian + damping, transposed @ miss[open_][:, :, None])[
                :, :, 0
            ]
            self._line_search(points, found, miss, open_, step)
        left = int((np.linalg.norm(miss, axis=1) > tolerance).sum())
        if left:
            worst = np.linalg.norm(miss, axis=1).max()
            logger.warning(
                "inverse: %d of %d points are off by up to %.3g m (the field folds)", left, len(points), worst
            )
        return found

    def _line_search(self, points, found, miss, open_, step):
        """Take the longest of the halved steps that comes nearer, in place."""
        for _ in range(12):
            candidate = found[open_] - step
            candidate_miss = self(candidate) - points[open_]
            better = np.linalg.norm(candidate_miss, axis=1) < np.linalg.norm(miss[open_], axis=1)
            taken = open_[better]
            found[taken], miss[taken] = candidate[better], candidate_miss[better]
            open_, step = open_[~better], step[~better] / 2
            if not len(open_):
                return

    def save(self, path: str | Path):
        """Write the field as npz with a checksum."""
        save_arrays(path, KIND, {f.name: np.asarray(getattr(self, f.name)) for f in dataclasses.fields(self)})

    @classmethod
    def load(cls, path: str | Path) -> "DeformationField":
        """Read a field that `save` wrote.

        Raises:
            FieldFileError: missing, corrupt or not a field.
        """
        data = load_arrays(path, KIND)
        return cls(
            data["control_points"], data["weights"], float(data["beta"]), data["centre"], float(data["scale"])
        )

    @property
    def normaliser(self) -> Normaliser:
        """From metres to the units of beta and the weights."""
        return Normaliser(self.centre, self.scale)

    def _carriers(self, count: int) -> tuple[Float[np.ndarray, "r 3"], Float[np.ndarray, "r 3"]]:
        """Control points and weights, fewer where so many points are asked for that it pays."""
        if count * len(self.control_points) > COMPRESS_ABOVE:
            return self._compressed
        return self.normaliser(self.control_points), self.weights

    @cached_property
    def _compressed(self):
        return compress(self.normaliser(self.control_points), self.beta, self.weights)


@dataclass(frozen=True, eq=False)
class FieldPair:
    """The map from instance A to instance B, through the canonical model both were registered to.

    Args:
        field_a: canonical to A.
        field_b: canonical to B.
    """

    field_a: DeformationField
    field_b: DeformationField

    def __call__(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points on B [m] of points on A [m]."""
        return self.field_b(self.field_a.inverse(points))

    def displacement(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """How far points on A move [m]."""
        return self(points) - check_points(points, "points")

    def jacobian(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3 3"]:
        """dB/dA at points on A [m]."""
        canonical = self.field_a.inverse(points)
        return self.field_b.jacobian(canonical) @ np.linalg.inv(self.field_a.jacobian(canonical))

    def inverse(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points on A [m] of points on B [m]."""
        return self.field_a(self.field_b.inverse(points))


def register_pair(field_a: DeformationField, field_b: DeformationField) -> FieldPair:
    """Register instance A to instance B: A -> canonical -> B (Rodriguez et al. 2020, figure 2)."""
    return FieldPair(field_a, field_b)


def positive(value, name: str) -> float:
    """Return `value` as a float.

    Raises:
        SettingsError: not a finite number above zero.
    """
    if isinstance(value, bool) or np.ndim(value) != 0 or np.asarray(value).dtype.kind not in "fiu":
        raise SettingsError("must be a number above 0", key=name, value=value)
    if not (np.isfinite(value) and value > 0):
        raise SettingsError("must be a finite number above 0", key=name, value=float(value))
    return float(value)
