"""`bench registration` and `bench pose-noise`: the paper's tables I and II, all methods in one run."""

from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from grasptransfer.benchmark.document import document
from grasptransfer.benchmark.errors_of_shape import ShapeError, outer_surface, shape_error
from grasptransfer.benchmark.estimators import NAMES, EstimatorSet
from grasptransfer.benchmark.seen_instances import instances, observe_instance
from grasptransfer.errors import SettingsError
from grasptransfer.frames import rotation_angle
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.scenes import PoseNoise

CANONICAL_POINTS = 8000


@dataclass(frozen=True)
class RegistrationSettings:
    """What is measured.

    Args:
        categories: names.
        meshes: folder of `<category>/<name>/mesh.*`; None takes the shipped test instances.
        views: of the 74, spread evenly.
        seed: of lights, backgrounds and pose errors.
        translation_noise: half-width of the told pose's error on each axis [m]; 0 tells the true pose.
        rotation_noise: largest turn of the told pose [rad].
        refine_pose: whether `rgb` and `cls` refine the pose.
    """

    categories: tuple[str, ...]
    meshes: Path | None = None
    views: int = 74
    seed: int = 0
    translation_noise: float = 0.0
    rotation_noise: float = 0.0
    refine_pose: bool = False


def run_registration_benchmark(
    settings: RegistrationSettings, *, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Errors of every method on every instance and view, as the contract's JSON document."""
    _check(settings)
    found = [(i.category.name, i.name) for i in instances(list(settings.categories), settings.meshes)]
    rows = []
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        tasks = [pool.submit(_measure_instance, settings, *names) for names in found]
        for done, task in enumerate(as_completed(tasks), start=1):
            rows.append(task.result())
            if progress:
                progress(done, len(tasks))
    rows.sort(key=lambda row: (row["category"], row["instance"]))
    return document("registration", settings=asdict(settings), rows=rows, summary=summarise(rows))


def run_pose_noise_benchmark(settings: RegistrationSettings, *, workers: int = 1, progress=None) -> dict:
    """The registration benchmark with and without pose errors, on the same views; `rgb` refines the pose."""
    quiet = RegistrationSettings(
        settings.categories, settings.meshes, settings.views, settings.seed, refine_pose=settings.refine_pose
    )
    calm = run_registration_benchmark(quiet, workers=workers, progress=progress)
    noisy = run_registration_benchmark(settings, workers=workers, progress=progress)
    growth = []
    for with_noise, without in zip(noisy["rows"], calm["rows"], strict=True):
        with_noise["rgb_without_noise"] = without["rgb"]
        growth.append(with_noise["rgb"]["mean"] / without["rgb"]["mean"])
    summary = noisy["summary"] | {
        "noise_growth_mean": float(np.mean(growth)),
        "noise_growth_worst": float(np.max(growth)),
        "pose_error_before_mm": float(np.mean([row["pose_error_before_mm"] for row in noisy["rows"]])),
        "pose_error_after_mm": float(np.mean([row["pose_error_after_mm"] for row in noisy["rows"]])),
        "pose_error_before_deg": float(np.mean([row["pose_error_before_deg"] for row in noisy["rows"]])),
        "pose_error_after_deg": float(np.mean([row["pose_error_after_deg"] for row in noisy["rows"]])),
    }
    return document("pose-noise", settings=asdict(settings), rows=noisy["rows"], summary=summary)


def _measure_instance(settings: RegistrationSettings, category: str, name: str) -> dict:
    instance = next(i for i in instances([category], settings.meshes) if i.name == name)
    truth = outer_surface(instance.solid, CANONICAL_POINTS // 2)
    canonical = outer_surface(instance.category.canonical, CANONICAL_POINTS)
    noise = PoseNoise(settings.translation_noise, settings.rotation_noise)
    errors: dict[str, list[ShapeError]] = defaultdict(list)
    ious, before, after = [], [], []
    with Renderer() as renderer:
        estimators = EstimatorSet(renderer, settings.refine_pose).of(instance, NAMES)
        for view in range(settings.views):
            observation, pose = observe_instance(
                instance, view, views=settings.views, renderer=renderer, noise=noise, seed=settings.seed
            )
            for method, estimator in estimators.items():
                estimate = estimator(observation)
                errors[method].append(shape_error(truth, estimate.field(canonical)))
                if method == "rgb":
                    ious.append(_iou(estimate.mask, observation.mask))
                    before.append(_pose_error(observation.camera_from_object, pose))
                    after.append(_pose_error(estimate.camera_from_object, pose))
    return {
        "category": category,
        "instance": name,
        "views": settings.views,
        **{method: _spread(values) for method, values in errors.items()},
        "rgb_mask_iou": float(np.mean(ious)),
        **_pose_summary("before", before),
        **_pose_summary("after", after),
    }


def summarise(rows: list[dict]) -> dict:
    """Ratios between methods, instance by instance, averaged."""

    def ratios(other: str) -> list[float]:
        return [row["rgb"]["mean"] / row[other]["mean"] for row in rows]

    return {
        "instances": len(rows),
        **{f"E_{name}_mean": float(np.mean([row[name]["mean"] for row in rows])) for name in NAMES},
        "rgb_over_gt_mean": float(np.mean(ratios("gt"))),
        "rgb_over_gt_worst": float(np.max(ratios("gt"))),
        "rgb_over_cpd_mean": float(np.mean(ratios("cpd"))),
        "rgb_over_cls_mean": float(np.mean(ratios("cls"))),
        "rgb_over_rigid_mean": float(np.mean(ratios("rigid"))),
        "rgb_over_similarity_mean": float(np.mean(ratios("similarity"))),
        "rgb_beats_cpd": sum(ratio < 1 for ratio in ratios("cpd")),
        "rgb_mask_iou_mean": float(np.mean([row["rgb_mask_iou"] for row in rows])),
    }


def _spread(errors: list[ShapeError]) -> dict[str, float]:
    values = np.array([error.E for error in errors])
    return {
        "mean": float(values.mean()),
        "std": float(values.std()),
        "rms_mm": float(np.mean([error.rms_mm for error in errors])),
        "chamfer_mm": float(np.mean([error.chamfer_mm for error in errors])),
    }


def _pose_error(estimated: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    turn = rotation_angle(estimated[:3, :3] @ true[:3, :3].T)
    return float(np.linalg.norm(estimated[:3, 3] - true[:3, 3])) * 1e3, float(np.rad2deg(turn))


def _pose_summary(when: str, errors: list[tuple[float, float]]) -> dict[str, float]:
    shift, turn = np.mean(errors, axis=0)
    return {f"pose_error_{when}_mm": float(shift), f"pose_error_{when}_deg": float(turn)}


def _iou(predicted: np.ndarray, true: np.ndarray) -> float:
    return float((predicted & true).sum() / max((predicted | true).sum(), 1))


def _check(settings: RegistrationSettings):
    if not 1 <= settings.views <= 74:
        raise SettingsError("must lie between 1 and 74", key="views", value=settings.views)
    if settings.meshes is not None and not settings.meshes.is_dir():
        raise SettingsError("is not a folder", path=settings.meshes)
    if not settings.categories:
        raise SettingsError("names no category", key="categories", value=settings.categories)
