"""`bench engines`: the same grasps in each physics engine, and how often the verdicts agree.

The true field moves the annotated grasps to unseen instances, and they are refined and placed as in a
transfer. The best grasp of each symmetry family is executed on the true mesh, with the same errors in each
engine. The engines are compared with each other, not with the world: where they agree, a verdict does not
depend on how contacts are computed.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.grasping import load_gripper
from grasptransfer.options import GripperName, Protocol, check_counts
from grasptransfer.simulation import TrialResult, installed_engines, load_protocol, simulate
from grasptransfer.simulation.engines import choose_engine, engine_version
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import TrueFieldEstimator
from grasptransfer.workshop.benchmark.grasp import as_executed, best_of_each_family
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import Categories, Meshes, name_trained
from grasptransfer.workshop.benchmark.seen_instances import (
    instance_names,
    load_instance,
    observe_instance,
    viewpoints_of,
)


@dataclass(frozen=True)
class EngineSettings:
    """What is measured.

    Args:
        engines: names of the engines; by default all that are installed.
        trials: perturbed trials of each grasp; 1 executes it exactly.
        seed: seed of the perturbations.
    """

    categories: Categories = ()
    meshes: Meshes = None
    gripper: GripperName = "panda"
    protocol: Protocol = "lift-shake-v2"
    engines: tuple[str, ...] = ()
    trials: int = 1
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "trials")


def run_engine_benchmark(
    settings: EngineSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """The contract's JSON document: a row for each instance.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.

    Raises:
        SettingsError: fewer than two engines, an unknown protocol, or an engine that is not installed.
        GripperError: an unknown gripper.
    """
    engines = settings.engines or tuple(installed_engines())
    for engine in engines:
        choose_engine(engine)
    if len(set(engines)) < 2:
        raise SettingsError("needs two engines to compare", key="engines", value=list(engines))
    load_protocol(settings.protocol)
    load_gripper(settings.gripper)
    settings = EngineSettings(**{**asdict(settings), "engines": engines})
    names = [(c, name) for c in settings.categories for name in instance_names(c, settings.meshes)]
    rows = measure_instances(
        _measure_instance, settings, names, workers=workers, ledger=ledger, progress=progress
    )
    versions = {engine: engine_version(engine) for engine in engines}
    return document(
        "engines",
        settings=asdict(settings) | {"versions": versions},
        rows=rows,
        summary=summary_of(rows, settings),
    )


def _measure_instance(settings: EngineSettings, category: str, name: str) -> dict:
    instance = load_instance(category, name, settings.meshes)
    estimator = TrueFieldEstimator(instance)
    flow = GraspTransfer(instance.category, gripper=load_gripper(settings.gripper), estimator=estimator)
    with Renderer() as renderer:
        (viewpoint,) = viewpoints_of(name, 1)
        observation, pose = observe_instance(instance, viewpoint, renderer=renderer, seed=settings.seed)
    result = flow.grasp(observation, estimator(observation))
    placed = as_executed(
        best_of_each_family(result.grasps), estimated_pose=result.camera_from_object, true_pose=pose
    )
    found = {
        engine: simulate(
            placed,
            instance.solid,
            result.gripper,
            settings.protocol,
            engine=engine,
            trials=settings.trials,
            seed=settings.seed,
        )
        for engine in settings.engines
    }
    return {"category": category, "instance": name, "grasps": len(placed), **compared(found)}


def compared(found: Mapping[str, Sequence[TrialResult]]) -> dict[str, Any]:
    """How the same trials ended in each engine.

    Args:
        found: results of each engine, in the same order.
    """
    trials = len(next(iter(found.values())))
    verdicts = np.array([[trial.held for trial in trials] for trials in found.values()])
    endings = zip(*found.values(), strict=True)
    apart = Counter(
        " / ".join(trial.status.name for trial in same)
        for same in endings
        if len({trial.held for trial in same}) > 1
    )
    return {
        "trials": trials,
        "agree": int((verdicts == verdicts[0]).all(axis=0).sum()),
        "held": {engine: int(held.sum()) for engine, held in zip(found, verdicts, strict=True)},
        "apart": dict(apart),
        "seconds": {engine: sum(trial.seconds for trial in trials) for engine, trials in found.items()},
    }


def summary_of(rows: Sequence[dict], settings: EngineSettings) -> dict[str, Any]:
    """Shares of trials on which the engines agree, by category; what the others say where one disagrees."""
    trials = sum(row["trials"] for row in rows)
    summary: dict[str, Any] = {
        "protocol": settings.protocol,
        "trials": trials,
        "agreement": sum(row["agree"] for row in rows) / trials,
    }
    for category in settings.categories:
        own = [row for row in rows if row["category"] == category]
        count = sum(row["trials"] for row in own)
        summary[f"agreement_{category}"] = sum(row["agree"] for row in own) / count if count else None
    for engine in settings.engines:
        summary[f"success_{engine}"] = sum(row["held"][engine] for row in rows) / trials
        summary[f"seconds_per_trial_{engine}"] = sum(row["seconds"][engine] for row in rows) / trials
    apart: Counter[str] = Counter()
    for row in rows:
        apart.update(row["apart"])
    summary["apart"] = {" / ".join(settings.engines): dict(apart.most_common())}
    summary["success_differs_by"] = max(
        abs(summary[f"success_{a}"] - summary[f"success_{b}"]) for a, b in combinations(settings.engines, 2)
    )
    return summary
