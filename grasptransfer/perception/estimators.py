"""Every estimator, registered once: `ESTIMATORS` serves API, commands, service and benchmarks.

An estimator is a callable `Observation -> ShapeEstimate`. A new one is written in a file of its own and added
to `ESTIMATORS`; its module is imported when one is made, so that the registry itself is light.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasptransfer.errors import SettingsError
from grasptransfer.perception.device import check_device
from grasptransfer.perception.precision import check_precision

if TYPE_CHECKING:
    from grasptransfer.category import Category
    from grasptransfer.perception.estimate import Estimator


@dataclass(frozen=True)
class EstimatorSettings:
    """What an estimator is made with, whichever it is; each takes from it what it has use for.

    Args:
        refine_pose: fit the pose together with the shape, where the estimator can.
        device: see `device.DEVICES`, of networks.
        precision: "auto", "float32" or "bfloat16", of networks.
        weights: a `.safetensors` file; None takes the one shipped for the category.
        masks_for_depth_alone: hide masks from the network and show it the box alone, as a detector gives
            it. Benchmarks do, which give the exact mask to the estimators that cut it out of depth.

    Raises:
        SettingsError: an unknown device or precision.
    """

    refine_pose: bool = True
    device: str = "auto"
    precision: str = "auto"
    weights: Path | None = None
    masks_for_depth_alone: bool = False

    def __post_init__(self):
        check_device(self.device)
        check_precision(self.precision)


@dataclass(frozen=True)
class EstimatorSpec:
    """One entry of the registry.

    Args:
        make: the estimator for a category; a bound is made for an instance, whose truth it knows.
        sentence: what it does, without a full stop, for help and documents.
        needs_depth: it uses a depth picture; without one it refuses, or says no more than the picture does.
        needs_box: it refuses a picture without box or mask.
        needs_mask: it refuses a picture without mask: a box also holds depth of what lies around.
        field_holds_pose: its field also takes up the error of the given pose, as it knows no category.
        bound: no method, but what methods are measured against.
        several_pictures: it takes several pictures of one object, and keeps what earlier ones have said.
    """

    make: Callable[[Any, EstimatorSettings], Estimator]
    sentence: str
    needs_depth: bool = False
    needs_box: bool = False
    needs_mask: bool = False
    field_holds_pose: bool = False
    bound: bool = False
    several_pictures: bool = False


def make_estimator(
    estimator: str | Estimator, category: Category, settings: EstimatorSettings | None = None
) -> Estimator:
    """The estimator of this name for a category; a callable is one already.

    Args:
        estimator: one of `ESTIMATORS`, or any callable `Observation -> ShapeEstimate`.
        category: whose instances it will see.
        settings: None takes the defaults.

    Raises:
        SettingsError: an unknown name.
        WeightsError: no trained network for the category.
    """
    if callable(estimator):
        return estimator
    check_estimators([estimator], key="estimator")
    return ESTIMATORS[estimator].make(category, settings or EstimatorSettings())


def check_estimators(names: Iterable[str], *, key: str, known: Iterable[str] | None = None) -> None:
    """Refuse names that are not registered.

    Args:
        key: the argument that holds them.
        known: the names there are; None takes `ESTIMATORS`.

    Raises:
        SettingsError: there is no such estimator; with the names there are.
    """
    choices = tuple(ESTIMATORS if known is None else known)
    for name in names:
        if name not in choices:
            raise SettingsError("unknown estimator", key=key, value=name, choices=choices)


def check_several_pictures(estimator: str | Estimator, key: str) -> None:
    """Refuse the name of an estimator that takes one picture at a time.

    Args:
        estimator: a name, or a callable, which answers for itself.
        key: the argument for which it must take several.

    Raises:
        SettingsError: it takes one picture; with the estimators that take several.
    """
    able = [name for name, spec in ESTIMATORS.items() if spec.several_pictures]
    if isinstance(estimator, str) and estimator not in able:
        raise SettingsError(f"estimator {estimator!r} takes one picture at a time", key=key, choices=able)


def _rgb(category: Category, settings: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.rgb import RgbEstimator

    estimator = RgbEstimator(
        category,
        weights=settings.weights,
        refine_pose=settings.refine_pose,
        device=settings.device,
        precision=settings.precision,
    )
    if settings.masks_for_depth_alone:
        return lambda observation: estimator(observation.without("depth", "mask"))
    return estimator


def _rgbd(category: Category, settings: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.rgbd import RgbdEstimator

    return RgbdEstimator(category, _rgb(category, settings))


def _cls(category: Category, settings: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.baselines import ClsEstimator

    return ClsEstimator(category, refine_pose=settings.refine_pose)


def _cpd(category: Category, _: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.baselines import CpdEstimator

    return CpdEstimator(category)


def _similarity(category: Category, _: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.baselines import SimilarityEstimator

    return SimilarityEstimator(category)


def _rigid(category: Category, _: EstimatorSettings) -> Estimator:
    from grasptransfer.perception.baselines import RigidEstimator

    return RigidEstimator(category)


ESTIMATORS: dict[str, EstimatorSpec] = {
    "rgb": EstimatorSpec(_rgb, "shape and pose from pictures, by the trained network", several_pictures=True),
    "rgbd": EstimatorSpec(_rgbd, "rgb, corrected by measured depth", needs_depth=True, several_pictures=True),
    "cls": EstimatorSpec(
        _cls, "shape space fitted to the depth cloud", needs_depth=True, needs_box=True, needs_mask=True
    ),
    "cpd": EstimatorSpec(
        _cpd,
        "CPD to the depth cloud",
        needs_depth=True,
        needs_box=True,
        needs_mask=True,
        field_holds_pose=True,
    ),
    "similarity": EstimatorSpec(_similarity, "the canonical model in another size", needs_box=True),
    "rigid": EstimatorSpec(_rigid, "the canonical model as it is"),
}
