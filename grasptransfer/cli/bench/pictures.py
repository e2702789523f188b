"""`bench registration` and its kin: how well shapes are read from pictures, and how fast."""

from functools import partial
from pathlib import Path

from grasptransfer.cli.bench.run import Results, ResumedResults, console, run
from grasptransfer.workshop.benchmark.deformation_maps import draw_deformation_maps
from grasptransfer.workshop.benchmark.glass import GlassSettings, run_glass_benchmark
from grasptransfer.workshop.benchmark.latency import LatencySettings, run_latency_benchmark
from grasptransfer.workshop.benchmark.photos import PhotoSettings, run_photo_benchmark
from grasptransfer.workshop.benchmark.pose import PoseSettings, run_pose_benchmark
from grasptransfer.workshop.benchmark.refusal import RefusalSettings, run_refusal_benchmark
from grasptransfer.workshop.benchmark.registration import (
    PoseNoiseSettings,
    RegistrationSettings,
    run_pose_noise_benchmark,
    run_registration_benchmark,
)


def registration(settings: RegistrationSettings, results: ResumedResults, maps: Path | None = None) -> int:
    """Errors of rgb, cls, cpd, rigid, similarity and true offsets on the same views (the paper's table I).

    Args:
        maps: PNG file for predicted and true deformations, one instance a category (the paper's figure 7).
    """
    code = run(partial(run_registration_benchmark, settings, **results.how()), results)
    if maps is not None:
        method = "rgb" if "rgb" in settings.methods else settings.methods[0]
        draw_deformation_maps(
            settings.categories,
            maps,
            method=method,
            meshes=settings.meshes,
            weights=settings.weights,
            seed=settings.seed,
        )
        console.print(f"Deformation maps of {method}: {maps}")
    return code


def pose_noise(settings: PoseNoiseSettings, results: ResumedResults) -> int:
    """The same with a wrong pose given to every method (the paper's table II); rgb and cls refine it."""
    return run(partial(run_pose_noise_benchmark, settings, **results.how()), results)


def glass(settings: GlassSettings, results: ResumedResults) -> int:
    """See-through instances: rgb, and rgbd, cls and cpd on true depth and on what a depth camera reports."""
    return run(partial(run_glass_benchmark, settings, **results.how()), results)


def photos(settings: PhotoSettings, results: ResumedResults) -> int:
    """Errors of rgb, rigid and similarity on real photographs with known poses (the paper's table III)."""
    return run(partial(run_photo_benchmark, settings, **results.how()), results)


def pose(settings: PoseSettings, results: ResumedResults, write: bool = False) -> int:
    """Poses found from box and intrinsics alone: share right within 10 degrees and 10 cm, 5 and 5, IoU 50 %.

    Args:
        write: fit the chances to the random shapes shown and write objects/models/poses.yaml, with this
            command and the date.
    """
    return run(partial(run_pose_benchmark, settings, **results.how(), write=write), results)


def refusal(settings: RefusalSettings, results: ResumedResults, write: bool = False) -> int:
    """How often right inputs are refused, and wrong ones noticed, named and kept from the gripper.

    Args:
        write: first fit the verdicts to pictures of random shapes, and to the photographs, and write them
            beside the weights, with this command and the date.
    """
    return run(partial(run_refusal_benchmark, settings, **results.how(), write=write), results)


def latency(settings: LatencySettings, results: Results) -> int:
    """Milliseconds of every stage of a transfer: median and 95th percentile; a cold start apart; memory."""
    return run(partial(run_latency_benchmark, settings), results)
