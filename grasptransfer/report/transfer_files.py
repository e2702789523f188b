"""`grasptransfer transfer`: files in, files out; nothing is left half-written where something goes wrong."""

import os
import tempfile
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from PIL import Image
from tyro.conf import Positional, arg

from grasptransfer.errors import ImageError
from grasptransfer.files import write_whole, writing
from grasptransfer.frames import invert
from grasptransfer.grasping import load_scene, placed_at
from grasptransfer.meshes import load_mesh
from grasptransfer.options import Device, EstimatorName, Precision, RefinePose, Seed, check_counts
from grasptransfer.perception.estimators import EstimatorSettings
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


@dataclass(frozen=True)
class TransferSettings:
    """Files in, files out, and how the grasps are transferred.

    Args:
        image: RGB picture.
        category: name or folder of the category.
        pose: YAML with camera_from_object (4x4, OpenCV, metres); also of BOP, ROS, MegaPose, and 4x4 text.
        out: folder for report.html, grasps.yaml and reconstruction.glb; files of these names are replaced.
        camera: YAML with fx fy cx cy width height; also camera_info, calibrations, 3x3 text; without it the
            photograph's EXIF data count, else 60 degrees are assumed.
        gripper: name, or YAML of your own.
        grasps: grasp file for this category in place of its own, as the annotator writes it.
        scene: YAML with obstacles and a support plane.
        mask: picture that is white on the object.
        box: u0 v0 u1 v1 around the object [px], as any detector gives it.
        execute: true mesh of the instance [m], standing at the given pose; the grasps are executed on it.
        pose_sigma: how sure the pose is: 0, exact; or standard deviations in metres and degrees; without it,
            the pose file's pose_sigma counts, or else the errors of real pose estimators.
        depth: 16-bit picture in millimetres, 0 = missing, for the estimators that use depth.

    Raises:
        SettingsError: a seed below 0, or an unknown device or precision.
    """

    image: Positional[Annotated[Path, arg(metavar="IMAGE")]]
    category: str
    pose: Path
    out: Path
    camera: Path | None = None
    gripper: str = "panda"
    grasps: Path | None = None
    scene: Path | None = None
    mask: Path | None = None
    box: tuple[float, float, float, float] | None = None
    execute: Path | None = None
    pose_sigma: tuple[float, ...] | None = None
    refine_pose: RefinePose = True
    estimator: EstimatorName = "rgb"
    depth: Path | None = None
    device: Device = "auto"
    precision: Precision = "auto"
    seed: Seed = 0

    def __post_init__(self):
        check_counts(self)
        EstimatorSettings(self.refine_pose, self.device, self.precision)

    @property
    def given_sigma(self) -> PoseSigma | None:
        """How sure the pose is, as `transfer_grasps` takes it."""
        sigma: Any = self.pose_sigma  # whatever its length, `transfer_grasps` answers what is wrong with it
        return sigma[0] if sigma is not None and len(sigma) == 1 else sigma


def run_transfer(settings: TransferSettings) -> TransferOutcome:
    """Transfer grasps to the instance in a picture, and write report, grasps and reconstruction.

    Raises:
        GraspTransferError: wrong input; nothing is written then.
    """
    check_folder(settings.out, "out")
    pixels, given = read_image(settings.image), read_pose(settings.pose, image=settings.image)
    seen = {
        "camera": camera_of(settings.image, settings.camera, *pixels.shape[1::-1]),
        "box": settings.box,
        "mask": None if settings.mask is None else load_mask(settings.mask),
        "depth": None if settings.depth is None else load_depth(settings.depth),
        "scene": None if settings.scene is None else load_scene(settings.scene),
        "pose_sigma": given.pose_sigma if settings.pose_sigma is None else settings.given_sigma,
    }
    true_mesh = None if settings.execute is None else load_mesh(settings.execute)
    flow = GraspTransfer(
        settings.category,
        gripper=settings.gripper,
        grasps=settings.grasps,
        estimator=settings.estimator,
        refine_pose=settings.refine_pose,
        device=settings.device,
        precision=settings.precision,
        seed=settings.seed,
    )
    result = flow.transfer(pixels, given.camera_from_object, **seen)
    trials = (
        ()
        if true_mesh is None
        else execute_best(result, true_mesh, given.camera_from_object, seed=settings.seed)
    )
    return write_outcome(result, trials, true_mesh, settings.out)


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
