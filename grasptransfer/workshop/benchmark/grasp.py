"""`bench grasp`: grasps of every estimator, executed in PyBullet on the true mesh of unseen instances."""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.frames import invert
from grasptransfer.grasping import PlacedGrasp, WarpedGrasp, load_gripper, placed_at
from grasptransfer.options import GripperName, Protocol, check_counts
from grasptransfer.perception.estimators import check_estimators
from grasptransfer.result import TransferredGrasp, TransferResult
from grasptransfer.simulation import load_protocol, simulate
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import DEFAULT, OF_GRASPS, EstimatorSet, shown_to
from grasptransfer.workshop.benchmark.given_poses import GivenPoses
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import (
    Categories,
    Meshes,
    Methods,
    Said,
    Together,
    Told,
    Views,
    name_trained,
)
from grasptransfer.workshop.benchmark.placed_boxes import PlacedScores, PlacedTruth, mean_shares
from grasptransfer.workshop.benchmark.reliability import Chance, summarise_chances
from grasptransfer.workshop.benchmark.seen_instances import (
    Instance,
    instance_names,
    load_instance,
    observe_instance,
    random_names,
    spread_views,
    viewpoints_of,
)

FIRST_SEED = 79_000_000  # of random shapes: far from those that networks, spaces and ranking were fitted to


@dataclass(frozen=True)
class GraspSettings:
    """What is measured.

    Args:
        objects: random shapes of each category instead of the test instances, each seen from the next
            viewpoints; 0: none.
        seed: seed of lights, backgrounds, pose errors and trials.
    """

    categories: Categories = ()
    meshes: Meshes = None
    objects: int = 0
    views: Views = 12
    views_together: Together = 1
    gripper: GripperName = "panda"
    protocol: Protocol = "lift-shake-v1"
    seed: int = 0
    told: Told = "estimator"
    pose_sigma: Said = ()
    estimators: Methods = DEFAULT

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views_together")
        GivenPoses.of(self.told, self.pose_sigma)


def run_grasp_benchmark(
    settings: GraspSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """Success of the annotated grasps under every estimator, as the contract's JSON document.

    The best-ranked member of each symmetry family is executed, as a robot would do.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.

    Raises:
        SettingsError: an unknown estimator or protocol, a wrong number of views, or both meshes and objects.
        GripperError: an unknown gripper.
    """
    check_estimators(settings.estimators, key="estimators", known=OF_GRASPS)
    load_protocol(settings.protocol)  # Wrong names are refused before minutes of rendering.
    load_gripper(settings.gripper)
    spread_views(settings.views)
    found = [(category, name) for category in settings.categories for name in _names(settings, category)]
    measured = measure_instances(
        _measure_instance, settings, found, workers=workers, ledger=ledger, progress=progress
    )
    rows = [row for instance in measured for row in instance["rows"]]
    rows.sort(key=lambda row: (row["category"], row["instance"], row["estimator"]))
    given = asdict(settings) | {"views_together": 1}
    return document("grasp", settings=given, rows=rows, summary=_summary(rows, settings))


def _names(settings: GraspSettings, category: str) -> list[str]:
    if not settings.objects:
        return instance_names(category, settings.meshes)
    if settings.meshes is not None:
        raise SettingsError("take the place of meshes: name one", key="objects", value=settings.objects)
    return random_names(settings.objects, FIRST_SEED)


def _measure_instance(settings: GraspSettings, category: str, name: str) -> dict:
    """`rows`, one for each estimator."""
    instance = load_instance(category, name, settings.meshes)
    gripper = load_gripper(settings.gripper)
    given = GivenPoses.of(settings.told, settings.pose_sigma)
    outcomes: dict[str, list[Outcome]] = defaultdict(list)
    placed = PlacedScores(PlacedTruth.of(instance.solid))
    with Renderer() as renderer:
        kit = EstimatorSet(refine_pose=True, registry=OF_GRASPS)
        estimators = kit.of(instance, settings.estimators)
        flows = {
            key: GraspTransfer(instance.category, gripper=gripper, estimator=estimator)
            for key, estimator in estimators.items()
        }
        for viewpoint in viewpoints_of(name, settings.views):
            observation, pose = observe_instance(
                instance,
                viewpoint,
                renderer=renderer,
                noise=given,
                seed=settings.seed,
                pictures=settings.views_together,
            )
            for key, flow in flows.items():
                seen = shown_to(key, observation)
                seen = replace(seen, camera_from_object=pose) if OF_GRASPS[key].bound else seen
                result = flow.grasp(seen, flow.estimator(seen))
                if key == "rgb":
                    placed.add(result, pose)
                outcomes[key].append(
                    execute(result, pose, instance.solid, protocol=settings.protocol, seed=settings.seed)
                )
    rows = {key: _row(instance, key, views) for key, views in outcomes.items()}
    if "rgb" in rows:
        rows["rgb"] |= placed.summary()
    return {"rows": list(rows.values())}


@dataclass(frozen=True)
class Outcome:
    """One picture: what was executed, best-ranked first, and what became of it."""

    grasps: list[TransferredGrasp]
    held: list[bool]
    reasons: list[str]

    @property
    def best_held(self) -> bool:
        """Whether the best-ranked grasp held; without a usable one the robot does not grasp: no success."""
        return bool(self.grasps) and self.grasps[0].usable and self.held[0]

    @property
    def usable_held(self) -> list[bool]:
        """Whether each grasp that was called usable held."""
        return [held for grasp, held in zip(self.grasps, self.held, strict=True) if grasp.usable]

    @property
    def chances(self) -> list[Chance]:
        """Every executed grasp that the gripper reaches on the reconstruction, best-ranked first."""
        return [Chance(g.score, held) for g, held in zip(self.grasps, self.held, strict=True) if g.score > 0]

    @property
    def best(self) -> Chance | None:
        """The best-ranked grasp; None where no grasp is usable."""
        return self.chances[0] if self.grasps and self.grasps[0].usable else None


def execute(
    result: TransferResult,
    true_pose: Float[np.ndarray, "4 4"],
    solid: trimesh.Trimesh,
    *,
    protocol: str = "lift-shake-v1",
    seed: int = 0,
) -> Outcome:
    """The best grasp of each symmetry family, executed on the true object at its true pose.

    Args:
        true_pose: `camera_from_object` [m].
        solid: the true object, its own frame [m].
        seed: seed of the trials.
    """
    grasps = best_of_each_family(result.grasps)
    placed = as_executed(grasps, estimated_pose=result.camera_from_object, true_pose=true_pose)
    density = result.category.density  # which the scores assume, too
    trials = simulate(placed, solid, result.gripper, protocol=protocol, density=density, seed=seed)
    reasons = [trial.status.name for trial in trials]
    return Outcome(grasps, [reason == "HELD" for reason in reasons], reasons)


def as_executed(
    grasps: Sequence[TransferredGrasp | WarpedGrasp], *, estimated_pose: np.ndarray, true_pose: np.ndarray
) -> list[PlacedGrasp]:
    """The grasps in the frame of the true object.

    The robot moves to where it believes a grasp is in the camera; the object is at its true pose.
    """
    true_from_estimated = invert(true_pose) @ estimated_pose
    return [placed_at(grasp, true_from_estimated @ grasp.object_from_gripper) for grasp in grasps]


def best_of_each_family(grasps: Sequence[TransferredGrasp]) -> list[TransferredGrasp]:
    """The first grasp of each symmetry family, in order: what a robot would do."""
    best: dict[str, TransferredGrasp] = {}
    for grasp in grasps:  # The grasps are ordered, the best first.
        best.setdefault(grasp.name.split("/")[0], grasp)
    return list(best.values())


def _row(instance: Instance, estimator: str, views: list[Outcome]) -> dict:
    held = [h for view in views for h in view.held]
    usable = [h for view in views for h in view.usable_held]
    top = [view.best_held for view in views]
    return {
        "category": instance.category.name,
        "instance": instance.name,
        "estimator": estimator,
        "views": len(views),
        "grasps": len(held),
        "success": float(np.mean(held)),
        "top1": float(np.mean(top)),
        "without_usable": sum(not view.usable_held for view in views),
        "usable": len(usable),
        "usable_held": int(sum(usable)),
        "reasons": dict(Counter(reason for view in views for reason in view.reasons)),
        "best": [None if view.best is None else asdict(view.best) for view in views],
        "executed": [asdict(chance) for view in views for chance in view.chances],
    }


def _chances(rows: list[dict]) -> tuple[list[Chance | None], list[Chance]]:
    """Of every view the best-ranked grasp, and all executed grasps."""
    best = [None if one is None else Chance(**one) for row in rows for one in row["best"]]
    return best, [Chance(**one) for row in rows for one in row["executed"]]


def _summary(rows: list[dict], settings: GraspSettings) -> dict:
    summary: dict[str, Any] = {"protocol": settings.protocol, "trials": sum(row["grasps"] for row in rows)}
    for name in settings.estimators:
        group = [row for row in rows if row["estimator"] == name]
        usable = sum(row["usable"] for row in group)
        summary[f"success_{name}"] = float(np.mean([row["success"] for row in group]))
        summary[f"top1_{name}"] = float(np.mean([row["top1"] for row in group]))
        summary[f"usable_precision_{name}"] = (
            sum(row["usable_held"] for row in group) / usable if usable else None
        )
        views, without = (sum(row[key] for row in group) for key in ("views", "without_usable"))
        summary[f"without_usable_{name}"] = without / views
        top = sum(row["top1"] * row["views"] for row in group)
        summary[f"top1_where_usable_{name}"] = top / (views - without) if views > without else None
        summary |= summarise_chances(name, *_chances(group))
    summary |= mean_shares(rows)
    if "rgb" in settings.estimators:
        summary["usable_precision"] = summary["usable_precision_rgb"]
        for other in {"rigid", "similarity"} & set(settings.estimators):
            summary[f"success_gain_over_{other}"] = summary["success_rgb"] - summary[f"success_{other}"]
        if "gt" in settings.estimators and summary["top1_gt"]:
            summary["top1_rgb_over_gt"] = summary["top1_rgb"] / summary["top1_gt"]
    return summary
