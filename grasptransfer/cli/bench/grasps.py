"""`bench grasp`, `engines` and `calibration`: whether transferred grasps hold when physics executes them."""

from functools import partial

from grasptransfer.cli.bench.run import ResumedResults, run
from grasptransfer.workshop.benchmark.calibration import CalibrationSettings, run_calibration
from grasptransfer.workshop.benchmark.engines import EngineSettings, run_engine_benchmark
from grasptransfer.workshop.benchmark.grasp import GraspSettings, run_grasp_benchmark


def grasp(settings: GraspSettings, results: ResumedResults) -> int:
    """Grasp success in physics, on the true mesh, of rgb and the baselines."""
    return run(partial(run_grasp_benchmark, settings, **results.how()), results)


def engines(settings: EngineSettings, results: ResumedResults) -> int:
    """The same grasps, moved by the true field, in each physics engine, and how often the verdicts agree."""
    return run(partial(run_engine_benchmark, settings, **results.how()), results)


def calibration(settings: CalibrationSettings, results: ResumedResults, write: bool = False) -> int:
    """Whether a grasp's score is its chance to hold; prints the ranking's weights that make it so.

    Args:
        write: write the fitted weights into objects/models/ranking.yaml, with this command and the date.
    """
    return run(partial(run_calibration, settings, **results.how(), write=write), results)
