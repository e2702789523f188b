"""`bench latency`: how long a picture takes, stage by stage; a fresh process's first one apart.

Machines differ, so a fixed load is timed in the same run: float32 convolutions like a network's, on the same
threads. The ratio of the two times describes the code better than milliseconds do.
"""

import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace

import numpy as np

from grasptransfer.jobs import run_fresh
from grasptransfer.options import Device, EstimatorName, GripperName, Precision, RefinePose, check_counts
from grasptransfer.perception.device import answering_device
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.precision import answer_precision, multiplies_bfloat16
from grasptransfer.workshop.benchmark.document import document, processor_name
from grasptransfer.workshop.benchmark.estimators import OF_DEPTH
from grasptransfer.workshop.benchmark.options import Categories, name_trained
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
        categories: names, each in a fresh process; none given: all that have weights.
        views: pictures after the first one.
        repeats: how often all pictures are transferred; 100 show whether it slows down or takes more memory.
        seed: seed of the pictures.
    """

    categories: Categories = ()
    views: int = 20
    estimator: EstimatorName = "rgb"
    refine_pose: RefinePose = True
    gripper: GripperName = "panda"
    device: Device = "auto"
    precision: Precision = "auto"
    repeats: int = 1
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views", "repeats")


def run_latency_benchmark(
    settings: LatencySettings, *, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Milliseconds of every stage, as the contract's JSON document."""
    precision = answer_precision(settings.precision)
    rows: list[dict] = []
    starts, runs = [], []
    for done, category in enumerate(settings.categories, start=1):
        observations = _pictures(settings, category)
        begin = time.perf_counter()
        # A fresh process: nothing is imported, compiled or loaded yet.
        timed = run_fresh(_transfer_all, settings, category, observations)
        starts.append(time.perf_counter() - begin - timed.after_first)
        runs.append(timed)
        rows += stage_rows(category, timed.views)
        if progress:
            progress(done, len(settings.categories))
    cold, memory = 1e3 * float(np.median(starts)), float(max(run.memory for run in runs))
    summary = {
        **_medians(rows),
        "cold_ms": cold,
        "cold_start_ms": cold,
        "load_ms": 1e3 * float(np.median([run.load for run in runs])),
        "peak_memory_mb": memory * 1.048576,
        "peak_memory_mib": memory,
        **compared(runs),
        "precision": precision,
        "device": answering_device(settings.device, openvino_serves=precision == "float32"),
        "processor": processor_name(),
        "multiplies_bfloat16": multiplies_bfloat16("cpu"),
    }
    return document("latency", settings=asdict(settings), rows=rows, summary=summary)


@dataclass(frozen=True)
class Timed:
    """One process's work.

    Args:
        load: seconds to construct the flow.
        views: seconds of every stage for each picture, `repeats` times over; the first is cold.
        busy: seconds of every stage for each picture once more, beside a process that keeps one core busy.
        reference: seconds of the fixed load.
        memory: peak resident size [MiB].
        after_first: seconds that passed after the first picture.
    """

    load: float
    views: list[dict[str, float]]
    busy: list[dict[str, float]]
    reference: float
    memory: float
    after_first: float


def compared(runs: list[Timed]) -> dict[str, float]:
    """Ratios within the run: to the fixed load, beside a busy process, and of the last tenth to the first."""
    ratios = []
    for run in runs:
        total = np.array([view["total"] for view in run.views[1:] or run.views])
        tenth, middle = max(1, len(total) // 10), np.median(total)
        busy = np.median([view["total"] for view in run.busy])
        late = np.median(total[-tenth:]) / np.median(total[:tenth])
        ratios.append((1e3 * run.reference, middle / run.reference, busy / middle, late))
    names = ("reference_ms", "total_over_reference", "busy_over_alone", "last_tenth_over_first")
    return dict(zip(names, np.median(ratios, axis=0).tolist(), strict=True))


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
        precision=settings.precision,
        seed=settings.seed,
    )
    load = time.perf_counter() - begin

    def timed(seen: Observation) -> dict[str, float]:
        given = seen.mask if seen.mask is not None else seen.box
        result = flow.transfer(
            seen.image, seen.camera_from_object, camera=seen.camera, mask=given, depth=seen.depth
        )
        return dict(result.timings)

    views = [timed(observations[0])]
    first = time.perf_counter()
    before = reference_seconds()
    views += [timed(seen) for seen in observations[1:]]
    for _ in range(settings.repeats - 1):
        views += [timed(seen) for seen in observations]
    reference = (before + reference_seconds()) / 2
    with _busy_process():
        busy = [timed(seen) for seen in observations]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    memory = peak / (1024**2 if sys.platform == "darwin" else 1024)
    return Timed(load, views, busy, reference, memory, time.perf_counter() - first)


def reference_seconds(repeats: int = 15) -> float:
    """Median seconds of a fixed float32 load of 3.6 GFLOP: four convolutions, on torch's threads."""
    import torch

    picture = torch.ones(1, 64, 96, 128).to(memory_format=torch.channels_last)
    layer = torch.nn.Conv2d(64, 64, 3, padding=1, bias=False)
    layer = layer.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    spent = []
    with torch.inference_mode():
        for _ in range(repeats):
            begin = time.perf_counter()
            for _ in range(4):
                layer(picture)
            spent.append(time.perf_counter() - begin)
    return float(np.median(spent))


@contextmanager
def _busy_process() -> Iterator[None]:
    """Keep another process computing while the block runs."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _pictures(settings: LatencySettings, category: str) -> list[Observation]:
    """Views of all test instances in turn; estimators that use no depth are given the object's box alone."""
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
