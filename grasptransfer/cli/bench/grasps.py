"""`bench grasp`, `engines` and `calibration`: whether transferred grasps hold when physics executes them."""

import math
from functools import partial

from grasptransfer.cli.bench.arguments import (
    Categories,
    Estimators,
    Gripper,
    Json,
    Meshes,
    Rotation,
    Translation,
    Views,
    ViewsOfEach,
    Workers,
    trained,
)
from grasptransfer.cli.bench.run import ledger_of, run


def grasp(
    *,
    json: Json,
    categories: Categories = (),
    meshes: Meshes = None,
    objects: int = 0,
    views: Views = 12,
    estimators: Estimators = (),
    gripper: Gripper = "panda",
    protocol: str = "lift-shake-v1",
    translation: Translation = 0.0,
    rotation: Rotation = 0.0,
    workers: Workers = 2,
    seed: int = 0,
) -> int:
    """Grasp success in physics, on the true mesh, of rgb and the baselines.

    Args:
        objects: random shapes of each category instead of the test instances; 0: none.
        protocol: named and versioned execution protocol.
        seed: of lights, backgrounds, pose errors and trials.
    """
    from grasptransfer.workshop.benchmark.estimators import DEFAULT
    from grasptransfer.workshop.benchmark.grasp import GraspSettings, run_grasp_benchmark

    settings = GraspSettings(
        trained(categories),
        meshes,
        objects,
        views,
        gripper,
        protocol,
        seed,
        translation,
        math.radians(rotation),
        estimators or DEFAULT,
    )
    return run(partial(run_grasp_benchmark, settings, workers=workers, ledger=ledger_of(json)), json)


def engines(
    *,
    json: Json,
    categories: Categories = (),
    meshes: Meshes = None,
    gripper: Gripper = "panda",
    protocol: str = "lift-shake-v2",
    engines: tuple[str, ...] = (),
    trials: int = 1,
    workers: Workers = 2,
    seed: int = 0,
) -> int:
    """The same grasps, moved by the true field, in each physics engine, and how often the verdicts agree.

    Args:
        protocol: named and versioned execution protocol.
        engines: names; none given: all that are installed.
        trials: perturbed trials of each grasp; 1 executes it exactly.
        seed: of the perturbations.
    """
    from grasptransfer.workshop.benchmark.engines import EngineSettings, run_engine_benchmark

    settings = EngineSettings(trained(categories), meshes, gripper, protocol, engines, trials, seed)
    return run(partial(run_engine_benchmark, settings, workers=workers, ledger=ledger_of(json)), json)


def calibration(
    *,
    json: Json,
    categories: Categories = (),
    objects: int = 12,
    views: ViewsOfEach = 3,
    translation: Translation = 0.0,
    rotation: Rotation = 0.0,
    workers: Workers = 2,
    seed: int = 0,
    write: bool = False,
) -> int:
    """Whether a grasp's score is its chance to hold; prints the ranking's weights that make it so.

    Every other view of an object has the pose error, where one is given.

    Args:
        objects: random shapes of each category.
        seed: of lights, backgrounds, pose errors and trials.
        write: the fitted weights into objects/models/ranking.yaml, with this command and the date.
    """
    from grasptransfer.workshop.benchmark.calibration import CalibrationSettings, run_calibration

    settings = CalibrationSettings(
        trained(categories),
        objects,
        views,
        translation_noise=translation,
        rotation_noise=math.radians(rotation),
        seed=seed,
    )
    return run(partial(run_calibration, settings, workers=workers, ledger=ledger_of(json), write=write), json)
