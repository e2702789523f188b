"""`bench registration` and `bench pose-noise`: the paper's tables I and II, all methods in one run."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.options import check_counts
from grasptransfer.perception.estimators import check_estimators
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.signs import overlap_of
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import DEFAULT, METHODS, OF_SHAPES, EstimatorSet, shown_to
from grasptransfer.workshop.benchmark.given_poses import EXACT, GivenPoses
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.judge import Judge
from grasptransfer.workshop.benchmark.options import (
    Categories,
    Meshes,
    Methods,
    Said,
    Together,
    Told,
    Views,
    Weights,
    name_trained,
)
from grasptransfer.workshop.benchmark.placed_boxes import (
    PlacedScore,
    PlacedTruth,
    bounds_of,
    summarise_placed,
)
from grasptransfer.workshop.benchmark.registration_summary import ONE_VIEW, MethodScores, summarise
from grasptransfer.workshop.benchmark.seen_instances import (
    instance_names,
    load_instance,
    see_instance,
    spread_views,
)


@dataclass(frozen=True)
class RegistrationSettings:
    """What is measured.

    Args:
        seed: seed of lights, backgrounds and pose errors.
    """

    categories: Categories = ()
    meshes: Meshes = None
    views: Views = 74
    views_together: Together = 1
    seed: int = 0
    told: Told = "estimator"
    pose_sigma: Said = ()
    methods: Methods = DEFAULT
    weights: Weights = None

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views_together")
        _ = self.given

    @property
    def given(self) -> GivenPoses:
        """The given poses and their uncertainty."""
        return GivenPoses.of(self.told, self.pose_sigma)


@dataclass(frozen=True)
class PoseNoiseSettings(RegistrationSettings):
    """The same without the bound, beside rgb on exact poses; `--told wide` are the paper's errors.

    Args:
        seed: seed of lights, backgrounds and pose errors.
    """

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
        calm = replace(settings, told=EXACT, pose_sigma=(), methods=("rgb",))
        row["rgb_without_noise"] = measure_registration(calm, category, name)["rgb"]
        row["noise_growth"] = row["rgb"]["mean"] / row["rgb_without_noise"]["mean"]
    return row


def measure_registration(settings: RegistrationSettings, category: str, name: str) -> dict:
    """One instance: every method on every view."""
    instance = load_instance(category, name, settings.meshes)
    judge, truth = Judge.of(instance), PlacedTruth.of(instance.solid)
    scores: dict[str, MethodScores] = defaultdict(MethodScores)
    placed: dict[str, list[PlacedScore]] = defaultdict(list)
    with Renderer() as renderer:
        kit = EstimatorSet(refine_pose=True, weights=settings.weights)
        estimators = kit.of(instance, settings.methods)
        for viewpoint in spread_views(settings.views):
            sight = see_instance(
                instance,
                viewpoint,
                renderer=renderer,
                noise=settings.given,
                seed=settings.seed,
                pictures=settings.views_together,
            )
            for label, method, seen in _asked(settings, sight.observation):
                estimator = estimators[method]
                estimate = judge.ask(
                    estimator, seen, true_pose=sight.pose, method=method, scores=scores[label]
                )
                if method == "rgb":
                    scores[label].mask_ious.append(_iou(estimate.mask, seen.mask))
                    found = bounds_of(judge.canonical.warped(estimate.field))
                    placed[label].append(truth.score(estimate.camera_from_object, found, sight.pose))
                if label == "rgb":
                    canonical = np.asarray(instance.category.canonical.bounds)
                    placed["before"].append(truth.score(seen.camera_from_object, canonical, sight.pose))
    row = {"category": instance.category.name, "instance": name, "views": settings.views}
    row |= {method: values.as_data() for method, values in scores.items()}
    return row | _of_rgb(row, scores, placed)


def _asked(settings: RegistrationSettings, together: Observation) -> Iterator[tuple[str, str, Observation]]:
    """Each method with what it sees, by the name of its scores: one picture where it takes no more."""
    for method in settings.methods:
        yield method, method, shown_to(method, together)
        if method == "rgb" and settings.views_together > 1:
            yield ONE_VIEW, method, replace(together, further=())


def _of_rgb(row: dict, scores: dict[str, MethodScores], placed: dict[str, list[PlacedScore]]) -> dict:
    """Masks and poses of rgb, before and after, and its errors against those of other methods."""
    if "rgb" not in scores:
        return {}
    found = {"rgb_mask_iou": float(np.mean(scores["rgb"].mask_ious))}
    found |= summarise_placed(placed["before"], "_before") | summarise_placed(placed["rgb"])
    found |= _pose_means("before", placed["before"]) | _pose_means("after", placed["rgb"])
    if ONE_VIEW in placed:
        found |= _pose_means("after_one_view", placed[ONE_VIEW])
    others = [other for other in ("gt", "cpd", "cls") if other in row]
    return found | {f"rgb_over_{other}": row["rgb"]["mean"] / row[other]["mean"] for other in others}


def _pose_means(when: str, scores: list[PlacedScore]) -> dict[str, float]:
    return {
        f"pose_error_{when}_mm": float(np.mean([score.millimetres for score in scores])),
        f"pose_error_{when}_deg": float(np.mean([score.degrees for score in scores])),
    }


def _iou(predicted: np.ndarray | None, true: np.ndarray | None) -> float:
    if predicted is None or true is None:
        return 0.0
    return overlap_of(predicted, true)


def _check(settings: RegistrationSettings):
    spread_views(settings.views)  # This refuses a wrong number before the first picture.
    if settings.meshes is not None and not settings.meshes.is_dir():
        raise SettingsError("is not a folder", path=settings.meshes)
    if not settings.categories:
        raise SettingsError("names no category", key="categories", value=settings.categories)
    if not settings.methods:
        raise SettingsError("names none", key="estimators", value=settings.methods, choices=OF_SHAPES)
    check_estimators(settings.methods, key="estimators", known=OF_SHAPES)
