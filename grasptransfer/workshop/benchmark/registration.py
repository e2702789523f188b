"""`bench registration` and `bench pose-noise`: the paper's tables I and II, all methods in one run."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.frames import rotation_angle
from grasptransfer.options import check_counts
from grasptransfer.perception.estimators import check_estimators
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import DEFAULT, METHODS, OF_SHAPES, EstimatorSet
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.judge import Judge
from grasptransfer.workshop.benchmark.options import (
    Categories,
    Meshes,
    Methods,
    Rotation,
    Translation,
    Views,
    Weights,
    name_trained,
)
from grasptransfer.workshop.benchmark.registration_summary import MethodScores, summarise
from grasptransfer.workshop.benchmark.seen_instances import (
    instance_names,
    load_instance,
    see_instance,
    spread_views,
)
from grasptransfer.workshop.training.scenes import PoseNoise


@dataclass(frozen=True)
class RegistrationSettings:
    """What is measured.

    Args:
        seed: seed of lights, backgrounds and pose errors.
        refine_pose: let rgb, rgbd and cls refine the pose.
    """

    categories: Categories = ()
    meshes: Meshes = None
    views: Views = 74
    seed: int = 0
    translation_noise: Translation = 0.0
    rotation_noise: Rotation = 0.0
    refine_pose: bool = False
    methods: Methods = DEFAULT
    weights: Weights = None

    def __post_init__(self):
        name_trained(self)
        check_counts(self)

    @property
    def noise(self) -> PoseNoise:
        """Error of the given pose."""
        return PoseNoise(self.translation_noise, self.rotation_noise)


@dataclass(frozen=True)
class PoseNoiseSettings(RegistrationSettings):
    """The same, with the paper's pose errors by default.

    Args:
        seed: seed of lights, backgrounds and pose errors.
        refine_pose: let rgb, rgbd and cls refine the pose.
    """

    translation_noise: Translation = 0.05
    refine_pose: bool = True
    methods: Methods = METHODS


def run_registration_benchmark(
    settings: RegistrationSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """Errors of every method on every instance and view, as the contract's JSON document.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.
    """
    rows = _measure(measure_registration, settings, workers, ledger, progress)
    return document("registration", settings=asdict(settings), rows=rows, summary=summarise(rows))


def run_pose_noise_benchmark(
    settings: RegistrationSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """The registration benchmark with pose errors, and `rgb` on the same pictures without them.

    Args:
        settings, workers, ledger, progress: as for `run_registration_benchmark`.
    """
    rows = _measure(measure_pose_noise, settings, workers, ledger, progress)
    summary = summarise(rows)
    for key in (
        "pose_error_before_mm",
        "pose_error_after_mm",
        "pose_error_before_deg",
        "pose_error_after_deg",
    ):
        values = [row[key] for row in rows if key in row]
        if values:
            summary[key] = float(np.mean(values))
    growth = [row["noise_growth"] for row in rows if "noise_growth" in row]
    if growth:
        summary |= {"noise_growth_mean": float(np.mean(growth)), "noise_growth_worst": float(np.max(growth))}
        summary["pose_error_ratio"] = summary["pose_error_after_mm"] / summary["pose_error_before_mm"]
    return document("pose-noise", settings=asdict(settings), rows=rows, summary=summary)


def _measure(measure, settings: RegistrationSettings, workers: int, ledger, progress) -> list[dict]:
    _check(settings)
    found = [(name, one) for name in settings.categories for one in instance_names(name, settings.meshes)]
    return measure_instances(measure, settings, found, workers=workers, ledger=ledger, progress=progress)


def measure_pose_noise(settings: RegistrationSettings, category: str, name: str) -> dict:
    """One instance with pose errors, and `rgb` without."""
    row = measure_registration(settings, category, name)
    if "rgb" in settings.methods:
        calm = replace(settings, translation_noise=0.0, rotation_noise=0.0, methods=("rgb",))
        row["rgb_without_noise"] = measure_registration(calm, category, name)["rgb"]
        row["noise_growth"] = row["rgb"]["mean"] / row["rgb_without_noise"]["mean"]
    return row


def measure_registration(settings: RegistrationSettings, category: str, name: str) -> dict:
    """One instance: every method on every view."""
    instance = load_instance(category, name, settings.meshes)
    judge = Judge.of(instance)
    scores: dict[str, MethodScores] = defaultdict(MethodScores)
    before, after = [], []
    with Renderer() as renderer:
        kit = EstimatorSet(settings.refine_pose, weights=settings.weights)
        estimators = kit.of(instance, settings.methods)
        for viewpoint in spread_views(settings.views):
            sight = see_instance(
                instance, viewpoint, renderer=renderer, noise=settings.noise, seed=settings.seed
            )
            seen, pose = sight.observation, sight.pose
            for method, estimator in estimators.items():
                estimate = judge.ask(estimator, seen, true_pose=pose, method=method, scores=scores[method])
                if method == "rgb":
                    scores[method].mask_ious.append(_iou(estimate.mask, seen.mask))
                    before.append(_pose_error(seen.camera_from_object, pose))
                    after.append(_pose_error(estimate.camera_from_object, pose))
    row = {"category": instance.category.name, "instance": name, "views": settings.views}
    row |= {method: values.as_data() for method, values in scores.items()}
    if "rgb" in scores:
        row["rgb_mask_iou"] = float(np.mean(scores["rgb"].mask_ious))
        row |= _pose_summary("before", before) | _pose_summary("after", after)
        row |= {
            f"rgb_over_{other}": row["rgb"]["mean"] / row[other]["mean"]
            for other in ("gt", "cpd", "cls")
            if other in row
        }
    return row


def _pose_error(estimated: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    turn = rotation_angle(estimated[:3, :3] @ true[:3, :3].T)
    return float(np.linalg.norm(estimated[:3, 3] - true[:3, 3])) * 1e3, float(np.rad2deg(turn))


def _pose_summary(when: str, errors: list[tuple[float, float]]) -> dict[str, float]:
    shift, turn = np.mean(errors, axis=0)
    return {f"pose_error_{when}_mm": float(shift), f"pose_error_{when}_deg": float(turn)}


def _iou(predicted: np.ndarray | None, true: np.ndarray | None) -> float:
    if predicted is None or true is None:
        return 0.0
    return float((predicted & true).sum() / max((predicted | true).sum(), 1))


def _check(settings: RegistrationSettings):
    spread_views(settings.views)  # This refuses a wrong number before the first picture.
    if settings.meshes is not None and not settings.meshes.is_dir():
        raise SettingsError("is not a folder", path=settings.meshes)
    if not settings.categories:
        raise SettingsError("names no category", key="categories", value=settings.categories)
    if not settings.methods:
        raise SettingsError("names none", key="estimators", value=settings.methods, choices=OF_SHAPES)
    check_estimators(settings.methods, key="estimators", known=OF_SHAPES)
