"""Point clouds: checks, and the normaliser that makes beta independent of size and units."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import PointCloudError


@dataclass(frozen=True, eq=False)
class Normaliser:
    """Centre and RMS radius of a cloud: `normalised = (points - centre) / scale`.

    Args:
        centre: (3,) mean of the points [m].
        scale: root mean square distance from the centre [m].
    """

    centre: Float[np.ndarray, "3"]
    scale: float

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"]) -> "Normaliser":
        """The normaliser of a checked cloud; its centred points have unit RMS radius."""
        centre = points.mean(0)
        scale = float(np.sqrt(np.square(points - centre).sum(1).mean()))
        return cls(centre, scale or 1.0)

    def __call__(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Metres to normalised units."""
        return (points - self.centre) / self.scale

    def undo(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Normalised units to metres."""
        return points * self.scale + self.centre


def check_points(points, name: str, *, fewest: int = 0) -> Float[np.ndarray, "m 3"]:
    """Return `points` as a contiguous float64 (m, 3) array.

    Args:
        points: anything numpy reads as an (m, 3) array of numbers.
        name: name of the argument, for the error.
        fewest: number of points that are needed.

    Raises:
        PointCloudError: not numbers, not (m, 3), not finite, or too few.
    """
    try:
        array = np.asarray(points)
        if array.dtype.kind not in "fiu":
            raise TypeError(array.dtype)
        array = np.ascontiguousarray(array, dtype=float)
    except (TypeError, ValueError) as error:
        raise PointCloudError("must be an (m, 3) array of real numbers", key=name, value=points) from error
    if array.ndim != 2 or array.shape[1] != 3:
        fix = "Transpose it" if array.ndim == 2 and array.shape[0] == 3 else None
        raise PointCloudError("must have the shape (m, 3)", key=name, value=array.shape, fix=fix)
    bad = ~np.isfinite(array).all(1)
    if bad.any():
        raise PointCloudError(
            "holds NaN or infinity",
            key=name,
            value=f"{bad.sum()} of {len(array)} points, the first at index {int(np.argmax(bad))}",
            fix="Remove these points first",
        )
    if len(array) < fewest:
        raise PointCloudError(f"needs at least {fewest} points", key=name, value=len(array))
    return array


def check_cloud(points, name: str) -> Float[np.ndarray, "m 3"]:
    """Return `points` as `check_points` does, refusing clouds without any extent.

    Raises:
        PointCloudError: what `check_points` refuses; fewer than two points, or all in one place.
    """
    array = check_points(points, name, fewest=2)
    if not np.ptp(array, axis=0).max() > 0:
        raise PointCloudError("all points are in one place", key=name, value=array[0].tolist())
    return array
