"""`bench registration` and its kin: how well shapes are read from pictures, and how fast."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from grasptransfer.cli.arguments import EstimatorName
from grasptransfer.cli.bench.arguments import (
    Categories,
    Estimators,
    Gripper,
    Json,
    Meshes,
    ResumedJson,
    Rotation,
    Translation,
    Views,
    ViewsOfEach,
    Weights,
    Workers,
    trained,
)
from grasptransfer.cli.bench.run import console, ledger_of, run

if TYPE_CHECKING:
    from grasptransfer.workshop.benchmark.registration import RegistrationSettings


def registration(
    *,
    json: ResumedJson,
    categories: Categories = (),
    meshes: Meshes = None,
    views: Views = 74,
    estimators: Estimators = (),
    weights: Weights = None,
    refine_pose: bool = False,
    maps: Path | None = None,
    workers: Workers = 2,
    seed: int = 0,
) -> int:
    """Errors of rgb, cls, cpd, rigid, similarity and true offsets on the same views (the paper's table I).

    Args:
        refine_pose: let rgb and cls refine the (true) pose.
        maps: PNG for predicted and true deformations of one instance a category (the paper's figure 7).
        seed: of lights and backgrounds.
    """
    from grasptransfer.workshop.benchmark.estimators import DEFAULT
    from grasptransfer.workshop.benchmark.registration import RegistrationSettings, run_registration_benchmark

    settings = RegistrationSettings(
        trained(categories),
        meshes,
        views,
        seed,
        refine_pose=refine_pose,
        methods=estimators or DEFAULT,
        weights=weights,
    )
    benchmark = partial(run_registration_benchmark, settings, workers=workers, ledger=ledger_of(json))
    code = run(benchmark, json)
    if maps is not None:
        _draw_maps(settings, maps)
    return code


def _draw_maps(settings: "RegistrationSettings", path: Path):
    from grasptransfer.workshop.benchmark.deformation_maps import draw_deformation_maps

    method = "rgb" if "rgb" in settings.methods else settings.methods[0]
    draw_deformation_maps(
        settings.categories,
        path,
        method=method,
        meshes=settings.meshes,
        weights=settings.weights,
        seed=settings.seed,
    )
    console.print(f"Deformation maps of {method}: {path}")


def pose_noise(
    *,
    json: ResumedJson,
    categories: Categories = (),
    meshes: Meshes = None,
    views: Views = 74,
    translation: Translation = 0.05,
    rotation: Rotation = 0.0,
    estimators: Estimators = (),
    weights: Weights = None,
    workers: Workers = 2,
    seed: int = 0,
) -> int:
    """The same with a wrong pose told to every method (the paper's table II); rgb and cls refine it.

    Args:
        seed: of lights, backgrounds and pose errors.
    """
    from grasptransfer.workshop.benchmark.estimators import METHODS
    from grasptransfer.workshop.benchmark.registration import RegistrationSettings, run_pose_noise_benchmark

    settings = RegistrationSettings(
        trained(categories),
        meshes,
        views,
        seed,
        translation,
        math.radians(rotation),
        refine_pose=True,
        methods=estimators or METHODS,
        weights=weights,
    )
    return run(partial(run_pose_noise_benchmark, settings, workers=workers, ledger=ledger_of(json)), json)


def glass(
    *,
    json: ResumedJson,
    categories: tuple[str, ...] = ("bottle", "spray_bottle"),
    views: Views = 20,
    through: float = 0.5,
    gate: bool = True,
    translation: Translation = 0.0,
    rotation: Rotation = 0.0,
    weights: Weights = None,
    workers: Workers = 2,
    seed: int = 0,
) -> int:
    """See-through instances: rgb, and rgbd, cls and cpd on true depth and on what a depth camera reports.

    Args:
        categories: names; instances without see-through parts are left out.
        through: share of the unmeasured glass where the camera reports what lies behind, not a hole.
        gate: leave out depth that is too far from the told position to be the object's, for cls and cpd.
        seed: of lights, backgrounds, pose errors and the camera's noise.
    """
    from grasptransfer.perception.depth_sensor import DepthSensor
    from grasptransfer.workshop.benchmark.glass import GlassSettings, run_glass_benchmark
    from grasptransfer.workshop.training.scenes import PoseNoise

    sensor = DepthSensor(through=through)
    noise = PoseNoise(translation, math.radians(rotation)) if translation or rotation else None
    settings = GlassSettings(categories, views, seed, sensor, gate, weights=weights, pose_noise=noise)
    return run(partial(run_glass_benchmark, settings, workers=workers, ledger=ledger_of(json)), json)


def photos(
    *,
    json: ResumedJson,
    photos: Path,
    categories: Categories = (),
    refine_pose: bool = True,
    told_box: bool = True,
    depth: bool = False,
    grasps: bool = False,
    weights: Weights = None,
    workers: Workers = 2,
) -> int:
    """Errors of rgb, rigid and similarity on real photographs with known poses (the paper's table III).

    Args:
        photos: folder with pictures and photos.yaml.
        refine_pose: let rgb refine the given pose.
        told_box: tell rgb the object's box, as a detector would.
        depth: also measure rgbd, cls and cpd on photographs that come with depth.
        grasps: also execute transferred grasps in PyBullet, where a mesh is known.
    """
    from grasptransfer.workshop.benchmark.photos import PhotoSettings, run_photo_benchmark

    settings = PhotoSettings(photos, trained(categories), refine_pose, told_box, depth, grasps, weights)
    return run(partial(run_photo_benchmark, settings, workers=workers, ledger=ledger_of(json)), json)


def refusal(
    *,
    json: Json,
    categories: Categories = (),
    views: ViewsOfEach = 4,
    random_objects: int = 12,
    seed: int = 0,
) -> int:
    """How often rgb accepts objects of other categories or of none, and refuses its own.

    Args:
        random_objects: objects of no category beside the test instances.
        seed: of random objects, lights and backgrounds.
    """
    from grasptransfer.workshop.benchmark.refusal import RefusalSettings, run_refusal_benchmark

    settings = RefusalSettings(trained(categories), views, random_objects, seed)
    return run(partial(run_refusal_benchmark, settings), json)


def latency(
    *,
    json: Json,
    categories: tuple[str, ...] = (),
    views: int = 20,
    estimator: EstimatorName = "rgb",
    refine_pose: bool = True,
    gripper: Gripper = "panda",
    device: str = "auto",
    precision: str = "auto",
    repeats: int = 1,
    seed: int = 0,
) -> int:
    """Milliseconds of every stage of a transfer: median and 95th percentile; a cold start apart; memory.

    Args:
        categories: names, each in a fresh process; none given: all that have weights.
        views: pictures after the first one.
        refine_pose: fit the pose together with the shape.
        device: auto, cpu or cuda.
        precision: auto (float32), float32 or bfloat16, of networks.
        repeats: how often all pictures are transferred; 100 show whether it slows down or takes more memory.
        seed: of pictures.
    """
    from grasptransfer.workshop.benchmark.latency import LatencySettings, run_latency_benchmark

    settings = LatencySettings(
        trained(categories),
        views,
        estimator=estimator,
        refine_pose=refine_pose,
        gripper=gripper,
        device=device,
        precision=precision,
        repeats=repeats,
        seed=seed,
    )
    return run(partial(run_latency_benchmark, settings), json)
