"""What `grasptransfer transfer` is given: its settings, and what the files hold that they name."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from tyro.conf import Positional, arg

from grasptransfer.errors import ImageError
from grasptransfer.grasping import load_scene
from grasptransfer.meshes import load_mesh
from grasptransfer.options import Device, EstimatorName, Precision, RefinePose, Seed, check_counts
from grasptransfer.perception.estimators import EstimatorSettings
from grasptransfer.perception.observation import read_image
from grasptransfer.perception.picture_camera import camera_of
from grasptransfer.poses import PoseSigma, read_pose
from grasptransfer.transfer import GraspTransfer


@dataclass(frozen=True)
class TransferSettings:
    """Files in, files out, and how the grasps are transferred.

    Args:
        image: RGB picture; or a folder of them, each with its entry in the pose file, or a pose file of its
            name in a folder of poses.
        category: name or folder of the category.
        pose: YAML with camera_from_object (4x4, OpenCV, metres); also of BOP, ROS, MegaPose, and 4x4 text.
        out: folder for report.html, grasps.yaml and reconstruction.glb; files of these names are replaced. Of
            a folder of pictures, each has its folder in it.
        camera: YAML with fx fy cx cy width height; also camera_info, calibrations, 3x3 text; without it the
            photograph's EXIF data count, else 60 degrees are assumed.
        gripper: name, or YAML of your own.
        grasps: grasp file for this category in place of its own, as the annotator writes it.
        scene: YAML with obstacles and a support plane.
        mask: picture that is white on the object.
        box: u0 v0 u1 v1 around the object [px], as any detector gives it; without it, the pose file's box.
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


@dataclass(frozen=True)
class TransferInputs:
    """What the files of one picture hold.

    Args:
        pixels: (h, w, 3) RGB.
        camera_from_object: (4, 4) the given pose [m].
        seen: the other arguments of `GraspTransfer.transfer`.
        true_mesh: to execute the grasps on, or None.
    """

    pixels: UInt8[np.ndarray, "h w 3"]
    camera_from_object: Float[np.ndarray, "4 4"]
    seen: dict[str, Any]
    true_mesh: trimesh.Trimesh | None


def read_inputs(settings: TransferSettings) -> TransferInputs:
    """Read every file that the settings name.

    Raises:
        GraspTransferError: one of them is wrong.
    """
    pixels, given = read_image(settings.image), read_pose(settings.pose, image=settings.image)
    seen = {
        "camera": camera_of(settings.image, settings.camera, *pixels.shape[1::-1]),
        "box": given.box if settings.box is None else settings.box,
        "mask": None if settings.mask is None else load_mask(settings.mask),
        "depth": None if settings.depth is None else load_depth(settings.depth),
        "scene": None if settings.scene is None else load_scene(settings.scene),
        "pose_sigma": given.pose_sigma if settings.pose_sigma is None else settings.given_sigma,
    }
    true_mesh = None if settings.execute is None else load_mesh(settings.execute)
    return TransferInputs(pixels, given.camera_from_object, seen, true_mesh)


def flow_of(settings: TransferSettings) -> GraspTransfer:
    """What transfers grasps to every picture of these settings."""
    return GraspTransfer(
        settings.category,
        gripper=settings.gripper,
        grasps=settings.grasps,
        estimator=settings.estimator,
        refine_pose=settings.refine_pose,
        device=settings.device,
        precision=settings.precision,
        seed=settings.seed,
    )


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
