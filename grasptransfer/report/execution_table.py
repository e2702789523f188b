"""`grasptransfer simulate`: executed grasps as a table."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.formats import GraspSet, read_grasps
from grasptransfer.meshes import SMALLEST, MeshLimits, in_metres, read_mesh
from grasptransfer.options import Protocol, Seed, Workers, check_counts
from grasptransfer.poses import load_pose
from grasptransfer.report.result_files import check_folder
from grasptransfer.report.transfer_files import FRAMES_PER_SECOND

if TYPE_CHECKING:
    from grasptransfer.simulation import TrialResult


@dataclass(frozen=True)
class SimulationSettings:
    """Which grasps are executed on what, and how.

    Args:
        grasps: grasp file in any format `convert` reads.
        mesh: the object.
        gripper: name, or YAML of your own; default: the one that the grasp file names, or panda.
        pose: pose file of the object, for grasps that are in a camera's frame.
        scale: metres in one unit of the mesh; default: what the grasp file says, else 1.
        engine: pybullet or mujoco; default: PyBullet where it is installed.
        trials: perturbed trials of each grasp; 1 executes it exactly.
        mass: of the object [kg]; default: volume times density.
        density: of the object [kg/m3]; default: the protocol's.
        friction: of pad on object; default: the protocol's.
        force: of each pad [N], at most the gripper's limit; default: the protocol's.
        results: JSON lines that an interrupted run resumes from.
        movies: folder for a GIF of each trial; finished trials run again for it.

    Raises:
        SettingsError: no trials, no workers, or a seed below 0.
    """

    grasps: Path
    mesh: Path
    gripper: str | None = None
    pose: Path | None = None
    scale: float | None = None
    protocol: Protocol = "lift-shake-v1"
    engine: str | None = None
    trials: int = 1
    mass: float | None = None
    density: float | None = None
    friction: float | None = None
    force: float | None = None
    workers: Workers = 1
    results: Path | None = None
    movies: Path | None = None
    seed: Seed = 0

    def __post_init__(self):
        check_counts(self, "trials", "workers")


def run_simulation(settings: SimulationSettings) -> "Sequence[TrialResult]":
    """Execute the grasps of a file on a mesh in a physics engine.

    Raises:
        GraspTransferError: wrong input, named by file, key and value.
    """
    from grasptransfer.simulation import simulate

    if settings.movies is not None:
        check_folder(settings.movies, "movies")
    read = read_mesh(settings.mesh)
    found = _in_object_frame(settings)
    hand = found.gripper
    assert hand is not None  # every file is read for one
    scale = found.object_scale if settings.scale is None else settings.scale
    solid = in_metres(read, settings.mesh, limits=MeshLimits(scale, SMALLEST))
    outcomes = simulate(
        found.grasps,
        solid,
        hand,
        protocol=settings.protocol,
        engine=settings.engine,
        trials=settings.trials,
        mass=settings.mass,
        density=settings.density,
        friction=settings.friction,
        force=settings.force,
        workers=settings.workers,
        results_path=settings.results,
        seed=settings.seed,
        frames=None if settings.movies is None else FRAMES_PER_SECOND,
    )
    if settings.movies is not None:
        from grasptransfer.report.movie import save_movies

        save_movies(outcomes, solid, hand, settings.movies)
    return outcomes


def _in_object_frame(settings: SimulationSettings) -> GraspSet:
    found = read_grasps(settings.grasps, gripper=settings.gripper)
    try:
        return found.in_object_frame(None if settings.pose is None else load_pose(settings.pose))
    except GraspFileError as error:
        raise error.at(settings.grasps) from error


def execution_table(outcomes: "Sequence[TrialResult]") -> Table:
    """One row for each grasp, and a last one for all of them."""
    from grasptransfer.simulation.outcome import robustness

    many = max((outcome.trial for outcome in outcomes), default=0) > 0
    first = outcomes[0] if outcomes else None
    table = Table(title=f"{first.protocol}, {first.gripper}, {first.engine}" if first else "nothing executed")
    table.add_column("grasp")
    table.add_column("held", justify="right")
    if many:
        table.add_column("95 % interval", justify="right")
    table.add_column("slip mm", justify="right")
    table.add_column("what happened")
    groups: dict[str, list] = {}
    for outcome in outcomes:
        groups.setdefault(outcome.grasp, []).append(outcome)
    for found, group in zip(robustness(outcomes), groups.values(), strict=True):
        interval = [f"{found.low:.0%} to {found.high:.0%}"] if many else []
        table.add_row(found.grasp, f"{found.held}/{found.trials}", *interval, _slip(group), _events(group))
    held = sum(outcome.held for outcome in outcomes)
    table.add_section()
    table.add_row("all", f"{held}/{len(outcomes)}", *([""] if many else []), _slip(outcomes), "")
    return table


def _slip(group: "Sequence[TrialResult]") -> str:
    slips = [outcome.slip_mm for outcome in group if outcome.held]
    return f"{np.median(slips):.1f}" if slips else "-"


def _events(group: "Sequence[TrialResult]") -> str:
    if len(group) == 1:
        status, detail = group[0].status.value, group[0].detail
        return detail if detail.startswith(status) else f"{status}: {detail}".removesuffix(": ")
    counted = Counter(outcome.status.value for outcome in group).most_common()
    return ", ".join(f"{count} {text}" for text, count in counted)
