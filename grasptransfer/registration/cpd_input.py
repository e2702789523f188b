"""What CPD is given: checked clouds and options, and a source prepared for many targets."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Shaped

from grasptransfer.errors import PointCloudError, SettingsError
from grasptransfer.registration.alignment import ALIGNMENTS
from grasptransfer.registration.blocks import BLOCK, spatial_order
from grasptransfer.registration.clouds import Normaliser, check_cloud
from grasptransfer.registration.expectation import Traits
from grasptransfer.registration.field import positive
from grasptransfer.registration.kernels import PrincipalKernel

LARGEST_SIZE_RATIO = 20.0  # metres against millimetres, or inches, is more
LARGEST_OFFSET = 10.0  # of the centres, in RMS radii of the source
FAR_OUTLIER = 8.0  # times the median distance from the median point; a long drill has 3


@dataclass(frozen=True)
class Options:
    """Options of EM, checked."""

    lam: float
    outlier_weight: float | str
    tolerance: float
    max_iterations: int

    @classmethod
    def checked(cls, lam, outlier_weight, tolerance, max_iterations) -> "Options":
        """
        Raises:
            SettingsError: an option outside its range.
        """
        positive(lam, "lam")
        if outlier_weight != "estimate" and not (
            isinstance(outlier_weight, int | float) and 0 <= outlier_weight < 1
        ):
            raise SettingsError(
                "is out of range",
                key="outlier_weight",
                value=outlier_weight,
                choices=["0 <= w < 1", "estimate"],
            )
        if not (np.ndim(tolerance) == 0 and np.isfinite(tolerance) and tolerance >= 0):
            raise SettingsError("must be 0 or more", key="tolerance", value=tolerance)
        if not (isinstance(max_iterations, int | np.integer) and max_iterations >= 1):
            raise SettingsError("must be a whole number above 0", key="max_iterations", value=max_iterations)
        return cls(float(lam), outlier_weight, float(tolerance), int(max_iterations))

    @property
    def estimates_outliers(self) -> bool:
        """Whether w follows the data."""
        return self.outlier_weight == "estimate"

    @property
    def starts(self) -> tuple[tuple[float, bool], ...]:
        """Each w to start with, and whether it is held until sigma^2 has settled."""
        if isinstance(self.outlier_weight, str):
            return ((0.1, False), (0.5, True))
        return ((float(self.outlier_weight), False),)


@dataclass(frozen=True, eq=False)
class PreparedSource:
    """A source cloud with its kernel's factor, made once and used for every target.

    Args:
        points: (n, 3) [m].
        beta: width of the kernel in units of the cloud's RMS radius.
        kernel_tolerance: largest error of any entry of G; 1e-7 moves the result by less than 0.005 %.

    Raises:
        PointCloudError: not (n, 3), not finite, without extent, or with far outliers.
    """

    points: Shaped[np.ndarray, "..."]
    beta: float = 2.0
    kernel_tolerance: float = 1e-7

    def __post_init__(self):
        points = check_cloud(self.points, "source").copy()
        _refuse_far_points(points, "source", fix="Remove them: they would set the scale of the registration")
        points.flags.writeable = False
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "beta", positive(self.beta, "beta"))

    def check_beta(self, beta: float | None):
        """
        Raises:
            SettingsError: `beta` is given and is not the one this source was prepared for.
        """
        if beta is not None and beta != self.beta:
            raise SettingsError(f"the source was prepared for {self.beta}", key="beta", value=beta)

    @property
    def count(self) -> int:
        """n."""
        return len(self.points)

    @cached_property
    def normaliser(self) -> Normaliser:
        """Centre and RMS radius of the points."""
        return Normaliser.of(self.points)

    @cached_property
    def order(self) -> Shaped[np.ndarray, "n"]:
        """Neighbours in space become neighbours in memory."""
        return spatial_order(self.points, BLOCK)

    @cached_property
    def normalised(self) -> Float[np.ndarray, "n 3"]:
        """Y, in that order; one coordinate after the other in memory, as the E-step wants them."""
        return np.asfortranarray(self.normaliser(self.points[self.order]))

    @cached_property
    def kernel(self) -> PrincipalKernel:
        """G = L L^T, in that order."""
        return PrincipalKernel.of(self.normalised, self.beta, tolerance=self.kernel_tolerance)

    @cached_property
    def factor(self) -> Float[np.ndarray, "n r"]:
        """L in float32, as EM uses it: twice as fast, and as exact as the distances of the E-step."""
        return self.kernel.factor.astype(np.float32)

    def unordered(self, values: Shaped[np.ndarray, "n ..."]) -> Shaped[np.ndarray, "n ..."]:
        """Rows in the order of `points` again."""
        result = np.empty_like(values)
        result[self.order] = values
        return result


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Known pairs (Golyanik et al. 2016), in the prepared order; counts are zero where there are none."""

    counts: Float[np.ndarray, "n"]
    pull: Float[np.ndarray, "n 3"]
    sources: Shaped[np.ndarray, "c"]
    targets: Float[np.ndarray, "c 3"]
    variance: float

    def join(
        self, support: Float[np.ndarray, "n"], pull: Float[np.ndarray, "n 3"], variance: float
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """P 1 and P X - P 1 Y with what the pairs add."""
        if not len(self.sources):
            return support, pull
        share = variance / self.variance
        return support + share * self.counts, pull + share * self.pull

    def cost(self, moved: Float[np.ndarray, "n 3"]) -> float:
        """What the pairs add to the objective."""
        if not len(self.sources):
            return 0.0
        return float(0.5 / self.variance * np.square(moved[self.sources] - self.targets).sum())


def check_correspondences(
    pairs, accuracy: float | None, source: PreparedSource, target: Float[np.ndarray, "m 3"]
) -> Correspondences:
    """
    Raises:
        PointCloudError: pairs that are not (c, 2) whole numbers, or name points that do not exist.
    """
    accuracy = (
        0.01 if accuracy is None else positive(accuracy, "correspondence_std") / source.normaliser.scale
    )
    pairs = np.zeros((0, 2), dtype=int) if pairs is None else np.asarray(pairs)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise PointCloudError("must be (c, 2) whole numbers", key="correspondences", value=pairs.shape)
    limits = np.array([source.count, len(target)])
    if len(pairs) and ((pairs < 0) | (pairs >= limits)).any():
        raise PointCloudError(
            f"name points that do not exist; there are {limits[0]} source and {limits[1]} target points",
            key="correspondences",
            value=pairs.max(0).tolist(),
        )
    place = np.empty(source.count, dtype=int)
    place[source.order] = np.arange(source.count)
    sources, targets = place[pairs[:, 0]], target[pairs[:, 1]]
    counts, pull = np.zeros(source.count), np.zeros((source.count, 3))
    np.add.at(counts, sources, 1.0)
    np.add.at(pull, sources, targets - source.normalised[sources])
    return Correspondences(counts, pull, sources, targets, accuracy**2)


def check_target(
    target, source: PreparedSource, *, align_first: str, outlier_weight
) -> Float[np.ndarray, "m 3"]:
    """
    Raises:
        PointCloudError: not a cloud, in other units or elsewhere than the source, or far outliers at w = 0.
        SettingsError: an unknown `align_first`.
    """
    if align_first not in ALIGNMENTS:
        raise SettingsError("is unknown", key="align_first", value=align_first, choices=ALIGNMENTS)
    target = check_cloud(target, "target")
    if outlier_weight == 0:
        _refuse_far_points(
            target, "target", fix='Remove them, or set outlier_weight to their share or to "estimate"'
        )
    middle, radius = _robust_size(target)
    source_middle, source_radius = _robust_size(source.points)
    ratio = radius / source_radius
    if align_first in ("none", "rigid") and not 1 / LARGEST_SIZE_RATIO < ratio < LARGEST_SIZE_RATIO:
        raise PointCloudError(
            "is not of the source's size: other units?",
            key="target",
            value=f"{ratio:.3g} times as large",
            fix='Convert it to metres, or use align_first="similarity"',
        )
    offset = float(np.linalg.norm(middle - source_middle))
    if align_first == "none" and offset > LARGEST_OFFSET * max(source_radius, radius):
        raise PointCloudError(
            "lies elsewhere than the source",
            key="target",
            value=f"{offset:.3g} m away",
            fix='Express both in one frame, or use align_first="rigid"',
        )
    return target


def check_traits(
    source_traits, target_traits, trait_std: float, source: PreparedSource, target: Float[np.ndarray, "m 3"]
) -> Traits | None:
    """
    Raises:
        PointCloudError: traits of one cloud only, of the wrong shape or not finite.
    """
    positive(trait_std, "trait_std")
    if source_traits is None and target_traits is None:
        return None
    if source_traits is None or target_traits is None:
        missing = "source_traits" if source_traits is None else "target_traits"
        raise PointCloudError("traits are needed of both clouds or of none", key=missing, value=None)
    arrays = []
    for name, traits, count in (
        ("source_traits", source_traits, source.count),
        ("target_traits", target_traits, len(target)),
    ):
        array = np.asarray(traits, dtype=float)
        if array.ndim != 2 or len(array) != count or not np.isfinite(array).all():
            raise PointCloudError(f"must be ({count}, t) finite numbers", key=name, value=array.shape)
        arrays.append(array / trait_std)
    if arrays[0].shape[1] != arrays[1].shape[1]:
        raise PointCloudError("must have as many columns as source_traits", key="target_traits")
    return Traits(arrays[0][source.order], arrays[1])


def _robust_size(points: Float[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Median point, and median distance from it [m]."""
    middle = np.median(points, axis=0)
    distances = np.linalg.norm(points - middle, axis=1)
    return middle, float(np.median(distances)) or float(distances.mean())


def _refuse_far_points(points: Float[np.ndarray, "m 3"], name: str, *, fix: str):
    middle, radius = _robust_size(points)
    far = np.linalg.norm(points - middle, axis=1) > FAR_OUTLIER * radius
    if far.any():
        raise PointCloudError(
            "holds far outliers", key=name, value=f"{far.sum()} of {len(points)} points", fix=fix
        )
