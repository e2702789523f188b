"""`grasptransfer transfer`: files in, files out; nothing is left half-written where something goes wrong."""

import os
import tempfile
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from PIL import Image

from grasptransfer.errors import ImageError
from grasptransfer.files import write_whole, writing
from grasptransfer.frames import invert
from grasptransfer.grasping import load_scene, placed_at
from grasptransfer.meshes import load_mesh
from grasptransfer.perception.observation import read_image
from grasptransfer.perception.picture_camera import camera_of
from grasptransfer.poses import PoseSigma, read_pose
from grasptransfer.report.page import headline, write_page
from grasptransfer.report.result_files import GRASPS, RECONSTRUCTION, check_folder, save_result
from grasptransfer.report.scene_view import best_of_each_label, scene_glb
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
class Outcome:
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
    image: Path,
    pose: Path,
    category: str,
    *,
    out: Path,
    camera: Path | None = None,
    gripper: str = "panda",
    scene: Path | None = None,
    mask: Path | None = None,
    box: tuple[float, float, float, float] | None = None,
    depth: Path | None = None,
    execute: Path | None = None,
    estimator: str = "rgb",
    pose_sigma: PoseSigma | None = None,
    refine_pose: bool = True,
    device: str = "auto",
    precision: str = "auto",
    seed: int = 0,
) -> Outcome:
    """Transfer grasps to the instance in a picture, and write report, grasps and reconstruction.

    Args:
        image, pose, camera, mask, depth, scene: files, as the command line describes them.
        category, gripper: names, or paths of one's own.
        box: (u0, v0, u1, v1) around the object [px].
        execute: mesh of the instance, object frame [m]; it stands at the given pose.
        pose_sigma: how sure the pose is, as of `transfer_grasps`; None takes what the pose file says.
        out: folder, made where it is missing; files of the same names are replaced.

    Raises:
        GraspTransferError: wrong input; nothing is written then.
    """
    check_folder(out, "out")
    pixels, given = read_image(image), read_pose(pose, image=image)
    seen = {
        "camera": camera_of(image, camera, *pixels.shape[1::-1]),
        "box": box,
        "mask": None if mask is None else load_mask(mask),
        "depth": None if depth is None else load_depth(depth),
        "scene": None if scene is None else load_scene(scene),
        "pose_sigma": given.pose_sigma if pose_sigma is None else pose_sigma,
    }
    true_mesh = None if execute is None else load_mesh(execute)
    flow = GraspTransfer(
        category,
        gripper=gripper,
        estimator=estimator,
        refine_pose=refine_pose,
        device=device,
        precision=precision,
        seed=seed,
    )
    result = flow.transfer(pixels, given.camera_from_object, **seen)
    trials = () if true_mesh is None else execute_best(result, true_mesh, given.camera_from_object, seed=seed)
    return write_outcome(result, trials, true_mesh, out)


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
        simulate(placed, mesh, result.gripper, protocol=PROTOCOL, seed=seed, frames=FRAMES_PER_SECOND)
    )


def write_outcome(
    result: TransferResult,
    trials: "Sequence[TrialResult]",
    true_mesh: trimesh.Trimesh | None,
    out: Path,
) -> Outcome:
    """Write the report, the 3D scene and what `TransferResult.save` writes; all files or none."""
    out = Path(out)
    with replacing_files(out) as folder:
        save_result(result, folder)
        write_whole(folder / SCENE, scene_glb(result))
        write_page(result, folder / REPORT, trials=trials, executed_mesh=true_mesh, executed_why=EXECUTED_WHY)
    return Outcome(sentence(result, trials, out), bool(result.usable), result, tuple(trials), out)


def sentence(result: TransferResult, trials: "Sequence[TrialResult]", out: Path) -> str:
    """What was found, and where to look."""
    text = headline(result)
    if result.usable:
        best = result.usable[0]
        text += f"; the best is {best.name}, expected success {best.score:.0%}"
    if trials:
        held = sum(trial.held for trial in trials)
        text += f"; {held} of the {len(trials)} executed held ({trials[0].protocol} in {trials[0].engine})"
    if result.status.value != "ok":
        text += f". {result.status.advice.rstrip('.')}"
    return f"{text}. Look at {out / REPORT}; grasps: {out / GRASPS}; mesh: {out / RECONSTRUCTION}"


@contextmanager
def replacing_files(out: Path):
    """A folder beside `out`; its files move into `out` once the block has ended well."""
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        made = tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent)
    with made as name:
        yield Path(name)
        with writing(out):
            out.mkdir(exist_ok=True)
            for path in sorted(Path(name).iterdir()):
                os.replace(path, out / path.name)


def load_mask(path: Path) -> Bool[np.ndarray, "h w"]:
    """Where a picture is brighter than half.

    Raises:
        ImageError: it cannot be read.
    """
    return np.asarray(_opened(path).convert("L")) > 127


def load_depth(path: Path) -> Float[np.ndarray, "h w"]:
    """Metres of a 16-bit picture in millimetres, 0 = missing.

    Raises:
        ImageError: it cannot be read, or is no single channel of 16 or more bits.
    """
    picture = _opened(path)
    if not picture.mode.startswith("I"):
        raise ImageError(
            "must be a 16-bit grey picture in millimetres", path=path, key="depth", value=picture.mode
        )
    return np.asarray(picture).astype(float) / 1000


def _opened(path: Path) -> Image.Image:
    try:
        with Image.open(path) as picture:
            picture.load()
    except FileNotFoundError as error:
        raise ImageError("does not exist", path=path) from error
    except (OSError, ValueError) as error:
        raise ImageError(f"cannot be read as a picture: {error}", path=path) from error
    return picture
