"""`grasptransfer transfer`: files in, files out; nothing is left half-written where something goes wrong."""

import glob
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.errors import GraspTransferError
from grasptransfer.files import write_whole, writing
from grasptransfer.frames import invert
from grasptransfer.grasping import placed_at
from grasptransfer.report.page import headline, write_page
from grasptransfer.report.result_files import GRASPS, RECONSTRUCTION, check_folder, save_result
from grasptransfer.report.scene_view import best_of_each_label, scene_glb
from grasptransfer.report.transfer_inputs import TransferInputs, TransferSettings, flow_of, read_inputs
from grasptransfer.result import TransferResult
from grasptransfer.transfer import GraspTransfer

if TYPE_CHECKING:
    from grasptransfer.simulation import TrialResult

REPORT, SCENE = "report.html", "scene.glb"
PROTOCOL = "lift-shake-v1"
EXECUTED = 5  # usable grasps, the best of each label
EXECUTED_WHY = "The best usable grasp of each label was executed: one at each place that was annotated."
FRAMES_PER_SECOND = 10.0


@dataclass(frozen=True)
class TransferOutcome:
    """What a command found.

    Args:
        sentence: for the user: what was found, and where to look.
        usable: whether there is a grasp to execute.
        result: of the transfer.
        trials: of the execution.
        folder: with the files.
    """

    sentence: str
    usable: bool
    result: TransferResult
    trials: "tuple[TrialResult, ...]"
    folder: Path


def run_transfer(
    settings: TransferSettings, *, on_stage: Callable[[str], None] = lambda line: None
) -> TransferOutcome:
    """Transfer grasps to the instance in the pictures, and write report, grasps and reconstruction.

    Args:
        on_stage: called with one line that says what is done next.

    Raises:
        GraspTransferError: wrong input; nothing is written then.
    """
    check_folder(settings.out, "out")
    on_stage(f"reading {', '.join(str(image) for image in settings.image)}")
    given = read_inputs(settings)
    on_stage(f"loading the category {settings.category} and what estimates its shape")
    return transfer_inputs(flow_of(settings), given, settings, on_stage=on_stage)


def transfer_inputs(
    flow: GraspTransfer,
    given: TransferInputs,
    settings: TransferSettings,
    *,
    on_stage: Callable[[str], None] = lambda line: None,
) -> TransferOutcome:
    """Transfer, execute where a mesh is given, and write the files of one object."""
    on_stage("estimating the shape, transferring and checking the grasps")
    result, mesh = flow.transfer(**given.pictures, **given.others), given.true_mesh
    trials = ()
    if mesh is not None:
        on_stage(f"executing the best of {len(result.usable)} usable grasps")
        trials = execute_best(result, mesh, result.observation.camera_from_object, seed=settings.seed)
    on_stage(f"writing {settings.out / REPORT}")
    return write_outcome(result, trials, mesh, settings.out)


def execute_best(
    result: TransferResult,
    mesh: trimesh.Trimesh,
    camera_from_mesh: Float[np.ndarray, "4 4"],
    *,
    most: int = EXECUTED,
    seed: int = 0,
) -> "tuple[TrialResult, ...]":
    """Execute the best usable grasp of each label in the default physics engine.

    The robot goes to where it believes the grasp is, seen from the camera; the mesh stands where it
    really is. So errors of shape and of pose both count.

    Args:
        mesh: of the instance, its own frame [m].
        camera_from_mesh: (4, 4) where it stands [m].
        most: grasps to execute.
    """
    from grasptransfer.simulation import simulate

    mesh_from_camera = invert(camera_from_mesh)
    placed = [
        placed_at(grasp, mesh_from_camera @ grasp.camera_from_gripper)
        for grasp in best_of_each_label(result.usable)[:most]
    ]
    if not placed:
        return ()
    return tuple(
        simulate(
            placed,
            mesh,
            result.gripper,
            protocol=PROTOCOL,
            density=result.category.density,
            seed=seed,
            frames=FRAMES_PER_SECOND,
        )
    )


def write_outcome(
    result: TransferResult,
    trials: "Sequence[TrialResult]",
    true_mesh: trimesh.Trimesh | None,
    out: Path,
) -> TransferOutcome:
    """Write the report, the 3D scene and what `TransferResult.save` writes; all files or none."""
    out = Path(out)
    with replacing_files(out) as folder:
        save_result(result, folder)
        write_whole(folder / SCENE, scene_glb(result))
        write_page(result, folder / REPORT, trials=trials, executed_mesh=true_mesh, executed_why=EXECUTED_WHY)
    return TransferOutcome(sentence(result, trials, out), bool(result.usable), result, tuple(trials), out)


def sentence(result: TransferResult, trials: "Sequence[TrialResult]", out: Path) -> str:
    """What was found, and where to look."""
    text = headline(result)
    if result.usable:
        best = result.usable[0]
        text += f"; the best is {best.name}, expected success {best.score:.0%}"
    if trials:
        held = sum(trial.held for trial in trials)
        text += f"; {held} of the {len(trials)} executed held ({trials[0].protocol} in {trials[0].engine})"
    if result.pose_note is not None:
        text += f". {result.pose_note.rstrip('.')}"
    if result.status.value != "ok":
        text += f". {result.advice.rstrip('.')}"
    return f"{text}. Look at {out / REPORT}; grasps: {out / GRASPS}; mesh: {out / RECONSTRUCTION}"


@contextmanager
def replacing_files(out: Path):
    """A folder beside `out`; its files move into `out` once the block has ended well."""
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        _remove_left(out)
        made = tempfile.TemporaryDirectory(prefix=f".{out.name}.{os.getpid()}-", dir=out.parent)
    with made as name:
        try:
            yield Path(name)
        except GraspTransferError as error:
            if error.path is not None and Path(error.path).is_relative_to(name):
                raise error.at(out / Path(error.path).relative_to(name)) from error
            raise
        with writing(out):
            out.mkdir(exist_ok=True)
            for path in sorted(Path(name).iterdir()):
                os.replace(path, out / path.name)


def _remove_left(out: Path) -> None:
    """Remove what killed processes left beside `out`."""
    for path in out.parent.glob(f".{glob.escape(out.name)}.*-*"):
        number = path.name.removeprefix(f".{out.name}.").partition("-")[0]
        if number.isdecimal() and not Path(f"/proc/{number}").exists():
            shutil.rmtree(path, ignore_errors=True)
