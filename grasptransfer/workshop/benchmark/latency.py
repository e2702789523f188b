"""`bench latency`: how long a picture takes, stage by stage; a fresh process's first one apart."""

import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace

import numpy as np

from grasptransfer.errors import SettingsError
from grasptransfer.perception.observation import Observation
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.estimators import OF_DEPTH
from grasptransfer.workshop.benchmark.seen_instances import (
    instance_names,
    load_instance,
    observe_instance,
    spread_views,
)


@dataclass(frozen=True)
class LatencySettings:
    """What is measured.

    Args:
        categories: names, each in a process of its own.
        views: pictures after the first one.
        estimator: one of `ESTIMATORS`.
        refine_pose: fit the pose together with the shape.
        gripper: name.
        device: "auto", "cpu" or "cuda".
        seed: of pictures.
    """

    categories: tuple[str, ...]
    views: int = 20
    estimator: str = "rgb"
    refine_pose: bool = True
    gripper: str = "panda"
    device: str = "auto"
    seed: int = 0


def run_latency_benchmark(
    settings: LatencySettings, *, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Milliseconds of every stage, as the contract's JSON document.

    Raises:
        SettingsError: no views.
    """
    if settings.views < 1:
        raise SettingsError("must be at least 1", key="views", value=settings.views)
    rows: list[dict] = []
    starts, loads, memory = [], [], []
    for done, category in enumerate(settings.categories, start=1):
        observations = _pictures(settings, category)
        begin = time.perf_counter()
        # A fresh process: nothing is imported, compiled or loaded yet.
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            timed = pool.submit(_transfer_all, settings, category, observations).result()
        starts.append(time.perf_counter() - begin - sum(each["total"] for each in timed.views[1:]))
        loads.append(timed.load)
        memory.append(timed.memory)
        rows += stage_rows(category, timed.views)
        if progress:
            progress(done, len(settings.categories))
    summary = {
        **_medians(rows),
        "cold_start_ms": 1e3 * float(np.median(starts)),
        "load_ms": 1e3 * float(np.median(loads)),
        "peak_memory_mib": float(np.max(memory)),
    }
    return document("latency", settings=asdict(settings), rows=rows, summary=summary)


@dataclass(frozen=True)
class Timed:
    """One process's work.

    Args:
        load: seconds to construct the flow.
        views: seconds of every stage for each picture; the first is cold.
        memory: peak resident size [MiB].
    """

    load: float
    views: list[dict[str, float]]
    memory: float


def stage_rows(category: str, views: list[dict[str, float]]) -> list[dict]:
    """Median and 95th percentile of every stage [ms]; the first, cold picture counts apart.

    Args:
        views: seconds of every stage for each picture.
    """
    rows = []
    for stage in views[0]:
        warm = 1e3 * np.array([view.get(stage, 0.0) for view in views[1:] or views])
        rows.append(
            {
                "category": category,
                "stage": stage,
                "median_ms": float(np.median(warm)),
                "p95_ms": float(np.percentile(warm, 95)),
                "cold_ms": 1e3 * views[0][stage],
            }
        )
    return rows


def _transfer_all(settings: LatencySettings, category: str, observations: list[Observation]) -> Timed:
    begin = time.perf_counter()
    from grasptransfer.transfer import GraspTransfer

    flow = GraspTransfer(
        category,
        gripper=settings.gripper,
        estimator=settings.estimator,
        refine_pose=settings.refine_pose,
        device=settings.device,
        seed=settings.seed,
    )
    load = time.perf_counter() - begin
    views = []
    for seen in observations:
        told = seen.mask if seen.mask is not None else seen.box
        result = flow.transfer(
            seen.image, seen.camera_from_object, camera=seen.camera, mask=told, depth=seen.depth
        )
        views.append(dict(result.timings))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Timed(load, views, peak / (1024**2 if sys.platform == "darwin" else 1024))


def _pictures(settings: LatencySettings, category: str) -> list[Observation]:
    """Views in turn of all test instances; what uses no depth is told a box alone."""
    from grasptransfer.drawing.rendering import Renderer
    from grasptransfer.drawing.views import VIEWPOINTS

    names = instance_names(category, None)
    viewpoints = spread_views(min(settings.views + 1, VIEWPOINTS))
    seen = []
    with Renderer() as renderer:
        for view in range(settings.views + 1):
            instance = load_instance(category, names[view % len(names)], None)
            viewpoint = viewpoints[view % len(viewpoints)]
            observation, _ = observe_instance(instance, viewpoint, renderer=renderer, seed=settings.seed)
            if settings.estimator not in OF_DEPTH:
                observation = replace(observation, depth=None, mask=None)
            seen.append(observation)
    return seen


def _medians(rows: list[dict]) -> dict[str, float]:
    summary = {}
    for stage in dict.fromkeys(row["stage"] for row in rows):
        group = [row for row in rows if row["stage"] == stage]
        for key in ("median_ms", "p95_ms", "cold_ms") if stage == "total" else ("median_ms",):
            summary[f"{stage}_{key}"] = float(np.median([row[key] for row in group]))
    return summary
