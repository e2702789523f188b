"""`grasptransfer simulate`: executed grasps as a table."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from grasptransfer.errors import GraspFileError
from grasptransfer.grasping.formats import read_grasps
from grasptransfer.meshes import SMALLEST, in_metres, read_mesh
from grasptransfer.poses import load_pose
from grasptransfer.report.result_files import check_folder
from grasptransfer.report.transfer_files import FRAMES_PER_SECOND

if TYPE_CHECKING:
    from grasptransfer.simulation import TrialResult


def run_simulation(
    grasps: Path,
    mesh: Path,
    gripper: str | None = None,
    *,
    pose: Path | None = None,
    scale: float | None = None,
    protocol: str = "lift-shake-v1",
    engine: str | None = None,
    trials: int = 1,
    workers: int = 1,
    results: Path | None = None,
    seed: int = 0,
    movies: Path | None = None,
) -> tuple[Table, int]:
    """Execute the grasps of a file on a mesh in a physics engine; a table of them, and how many trials held.

    Args:
        grasps: file in any format `convert` reads; poses in the mesh's frame.
        mesh: of the object.
        gripper: name, or path of a YAML file; None: the one that the grasp file names, or the Panda.
        pose: file with the object's pose, for grasps in a camera's frame.
        scale: metres in one unit of the mesh; None: as the grasp file says, else 1.
        protocol: by name.
        engine: by name; None: PyBullet where it is installed.
        trials: of each grasp; 1 executes it exactly, more are perturbed.
        workers: processes.
        results: JSON lines to append to, and to resume from.
        seed: of the perturbations.
        movies: folder for a GIF of each trial; finished trials run again for it.

    Raises:
        GraspTransferError: wrong input, named by file, key and value.
    """
    from grasptransfer.simulation import simulate

    if movies is not None:
        check_folder(movies, "movies")
    read = read_mesh(mesh)
    found = read_grasps(grasps, gripper=gripper)
    try:
        found = found.in_object_frame(None if pose is None else load_pose(pose))
    except GraspFileError as error:
        raise error.at(grasps) from error
    hand = found.gripper
    assert hand is not None  # every file is read for one
    solid = in_metres(read, mesh, scale=found.object_scale if scale is None else scale, smallest=SMALLEST)
    outcomes = simulate(
        found.grasps,
        solid,
        hand,
        protocol=protocol,
        engine=engine,
        trials=trials,
        workers=workers,
        results_path=results,
        seed=seed,
        frames=None if movies is None else FRAMES_PER_SECOND,
    )
    if movies is not None:
        from grasptransfer.report.movie import save_movies

        save_movies(outcomes, solid, hand, movies)
    return execution_table(outcomes), sum(outcome.held for outcome in outcomes)


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
