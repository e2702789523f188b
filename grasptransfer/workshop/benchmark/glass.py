"""`bench glass`: see-through instances, by picture alone and by what a depth camera reports of them."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import trimesh

from grasptransfer.category import Category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.options import check_counts
from grasptransfer.perception.depth_sensor import DepthSensor, wall_behind
from grasptransfer.perception.estimators import ESTIMATORS
from grasptransfer.perception.observation import Observation
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import OF_DEPTH, EstimatorSet
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.judge import Judge
from grasptransfer.workshop.benchmark.options import Methods, Rotation, Translation, Views, Weights
from grasptransfer.workshop.benchmark.registration_summary import MethodScores
from grasptransfer.workshop.benchmark.seen_instances import (
    Sight,
    instance_names,
    load_instance,
    see_instance,
    spread_views,
)
from grasptransfer.workshop.training.scenes import PoseNoise

WALL = (0.05, 0.40)  # m behind the object
GATE = 1.5  # times the canonical model's radius
RIGHT = 0.01  # m: nearer to the truth a depth counts as measured


@dataclass(frozen=True)
class GlassSettings:
    """What is measured.

    Args:
        categories: names; instances without see-through parts are left out.
        seed: seed of lights, backgrounds, pose errors, walls and the sensor.
        sensor: the depth camera.
        gate: leave out depth that is too far from the given position to be the object's, as a careful user of
            CPD and CLS does. The method rgbd has to reject such depth by itself.
    """

    categories: tuple[str, ...] = ("bottle", "spray_bottle")
    views: Views = 20
    seed: int = 0
    sensor: DepthSensor = field(default_factory=DepthSensor)
    gate: bool = True
    methods: Methods = ("rgb", *OF_DEPTH)
    weights: Weights = None
    translation_noise: Translation = 0.0
    rotation_noise: Rotation = 0.0

    def __post_init__(self):
        check_counts(self)

    @property
    def pose_noise(self) -> PoseNoise | None:
        """Error of the given pose, which rgb, rgbd and cls then refine; None where the true one is given."""
        if self.translation_noise or self.rotation_noise:
            return PoseNoise(self.translation_noise, self.rotation_noise)
        return None


def run_glass_benchmark(
    settings: GlassSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """E of `rgb`, and of the depth methods on true and on sensed depth, on the same views.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.

    Raises:
        SettingsError: a wrong number of views, or no category has a see-through test instance.
    """
    spread_views(settings.views)  # This refuses a wrong number before the first picture.
    found = [
        (category, name)
        for category in settings.categories
        for name in instance_names(category, None)
        if see_through(load_instance(category, name, None).mesh)
    ]
    if not found:
        raise SettingsError(
            "have no see-through test instance",
            key="categories",
            value=settings.categories,
            choices=["bottle"],
        )
    rows = measure_instances(
        measure_glass, settings, found, workers=workers, ledger=ledger, progress=progress
    )
    return document("glass", settings=asdict(settings), rows=rows, summary=summarise_glass(rows))


def see_through(mesh: trimesh.Trimesh | trimesh.Scene) -> bool:
    """Whether light passes through any part."""
    parts = mesh.geometry.values() if isinstance(mesh, trimesh.Scene) else [mesh]
    materials = (getattr(part.visual, "material", None) for part in parts)
    return any(getattr(material, "alphaMode", None) == "BLEND" for material in materials)


def measure_glass(settings: GlassSettings, category: str, name: str) -> dict:
    """One instance on every view."""
    instance = load_instance(category, name, None)
    judge = Judge.of(instance)
    scores: dict[str, MethodScores] = defaultdict(MethodScores)
    shares: dict[str, list[float]] = defaultdict(list)
    with Renderer() as renderer:
        kit = EstimatorSet(refine_pose=settings.pose_noise is not None, weights=settings.weights)
        estimators = kit.of(instance, settings.methods)
        for view, viewpoint in enumerate(spread_views(settings.views)):
            sight = see_instance(
                instance, viewpoint, renderer=renderer, noise=settings.pose_noise, seed=settings.seed
            )
            sensed = sense(sight, settings, view)
            gated = _gated(sensed, instance.category) if settings.gate else sensed
            for key, value in _shares(sight, gated).items():
                shares[key].append(value)
            for key, (method, observation) in _cases(settings, sight.observation, sensed, gated).items():
                judge.ask(
                    estimators[method], observation, true_pose=sight.pose, method=method, scores=scores[key]
                )
    return {
        "category": instance.category.name,
        "instance": name,
        "views": settings.views,
        **{key: float(np.mean(values)) for key, values in shares.items()},
        **{key: values.as_data() for key, values in scores.items()},
    }


def sense(sight: Sight, settings: GlassSettings, view: int) -> Observation:
    """The observation with the depth that the sensor reports before a wall."""
    given = sight.observation
    assert given.depth is not None
    rng = np.random.default_rng([settings.seed, 11, view])
    centre = sight.pose[2, 3]
    nearest = float(given.depth[given.depth > 0].min())
    # The way through a round object is about twice that from its front to its middle.
    path = np.where(given.depth > 0, 2 * np.clip(centre - given.depth, 0, centre - nearest), 0.0)
    wall = wall_behind(
        given.camera,
        2 * centre - nearest + rng.uniform(*WALL),
        tilt=rng.uniform(0, 0.5),
        turn=rng.uniform(0, 2 * np.pi),
    )
    depth = settings.sensor.measure(
        given.depth, sight.coverage.astype(float), wall, camera=given.camera, rng=rng, path=path
    )
    return replace(given, depth=depth)


def _gated(sensed: Observation, category: Category) -> Observation:
    """The observation without depth that is farther from the given position than an instance can be large."""
    farthest = GATE * float(np.linalg.norm(category.canonical.extents)) / 2
    assert sensed.depth is not None
    away = np.abs(sensed.depth - sensed.camera_from_object[2, 3])
    return replace(sensed, depth=np.where(away < farthest, sensed.depth, 0.0))


def _cases(
    settings: GlassSettings, exact: Observation, sensed: Observation, gated: Observation
) -> dict[str, tuple[str, Observation]]:
    """Name of each case, its estimator and what that sees; the exact mask is for those that need it alone."""
    cases = {}
    for method in settings.methods:
        if method not in OF_DEPTH:
            cases[method] = (method, exact)
        elif ESTIMATORS[method].needs_box:
            cases |= {f"{method}_true_depth": (method, exact), f"{method}_sensor": (method, gated)}
        else:
            cases[f"{method}_true_depth"] = (method, replace(exact, mask=None))
            cases[f"{method}_sensor"] = (method, replace(sensed, mask=None))
    return cases


def _shares(sight: Sight, sensed: Observation) -> dict[str, float]:
    """How opaque the object is, and what share of its pixels is measured, missing or wrong."""
    mask, true = sight.observation.mask, sight.observation.depth
    assert mask is not None
    assert true is not None
    assert sensed.depth is not None
    reported, right = sensed.depth[mask], np.abs(sensed.depth - true)[mask] < RIGHT
    return {
        "opacity": float(sight.coverage[mask].mean()),
        "depth_right": float((right & (reported > 0)).mean()),
        "depth_missing": float((reported == 0).mean()),
        "depth_wrong": float((~right & (reported > 0)).mean()),
    }


def summarise_glass(rows: list[dict]) -> dict:
    """Means, and ratios instance by instance."""
    summary: dict[str, float | int] = {"instances": len(rows), "views": sum(row["views"] for row in rows)}
    for key in ("opacity", "depth_right", "depth_missing", "depth_wrong"):
        summary[f"{key}_mean"] = float(np.mean([row[key] for row in rows]))
    cases = [name for name, value in rows[0].items() if isinstance(value, dict)]
    for case in cases:
        summary[f"E_{case}_mean"] = float(np.mean([row[case]["mean"] for row in rows]))
        summary[f"E_{case}_std_mean"] = float(np.mean([row[case]["std"] for row in rows]))
        # The same error with the shape at its estimated pose: it differs where the given pose was wrong.
        summary[f"E_{case}_placed_mean"] = float(np.mean([row[case]["placed_mean"] for row in rows]))
        failed = sum(row[case]["failed"] for row in rows)
        if failed:
            summary[f"{case}_views_without_answer"] = failed
    for case in cases if "rgb" in cases else []:
        if case == "rgb":
            continue
        ratios = [row["rgb"]["mean"] / row[case]["mean"] for row in rows]
        summary[f"rgb_over_{case}_mean"] = float(np.mean(ratios))
        summary[f"rgb_beats_{case}"] = sum(ratio < 1 for ratio in ratios)
    return summary
