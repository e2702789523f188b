"""What `grasptransfer transfer` is given: its settings, and what the files hold that they name."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from PIL import Image
from tyro.conf import Positional, arg

from grasptransfer.errors import ImageError, SettingsError
from grasptransfer.grasping import Physics, load_scene
from grasptransfer.meshes import load_mesh
from grasptransfer.options import Device, EstimatorName, Precision, RefinePose, Seed, check_counts
from grasptransfer.perception.estimators import EstimatorSettings
from grasptransfer.perception.observation import read_image
from grasptransfer.perception.picture_camera import camera_of
from grasptransfer.perception.several_pictures import MOVED_CAMERA, check_views
from grasptransfer.poses import PoseSigma, read_pose
from grasptransfer.transfer import GraspTransfer


@dataclass(frozen=True)
class TransferSettings:
    """Files in, files out, and how the grasps are transferred.

    Args:
        image: RGB picture; or several, all of one object; or a folder of them, each of its own object, with
            its entry in the pose file, or a pose file of its name in a folder of poses.
        category: name or folder of the category.
        pose: YAML with camera_from_object (4x4, OpenCV, metres); also of BOP, ROS, MegaPose, and 4x4 text. Of
            several pictures one each, or one with an entry of each. Without it the pose of a picture is
            searched in the box, as `grasptransfer pose` does, and the report says how likely it is.
        out: folder for report.html, grasps.yaml and reconstruction.glb; files of these names are replaced. Of
            a folder of pictures, each has its folder in it.
        camera: YAML with fx fy cx cy width height; also camera_info, calibrations, 3x3 text; without it the
            photograph's EXIF data count, else 60 degrees are assumed. One for all pictures, or one each.
        gripper: name, or YAML of your own.
        grasps: grasp file for this category in place of its own, as the annotator writes it.
        scene: YAML with obstacles and a support plane.
        mask: picture that is white on the object; of several pictures one each.
        box: u0 v0 u1 v1 around the object [px], as any detector gives it; without it, the pose file's box. Of
            several pictures, four numbers each.
        execute: true mesh of the instance [m], standing at the given pose; the grasps are executed on it.
        pose_sigma: how sure the pose is: 0, exact; or standard deviations in metres and degrees; without it,
            the pose file's pose_sigma counts, or else the errors of real pose estimators.
        mass: of the object [kg], and a factor by which it may be larger or smaller; default: volume times the
            category's density.
        friction: of pad on object, and such a factor; default: 0.8 1.2.
        force: of each pad [N], and such a factor; default: 40, or the gripper's limit.
        depth: 16-bit picture in millimetres, 0 = missing, for the estimators that use depth; of several
            pictures one each.
        views: how the poses of several pictures go together. "moved camera": the camera moved about a
            standing object, and the differences of the poses are trusted; "separate": each pose errs by
            itself.

    Raises:
        SettingsError: a seed below 0, an unknown device or precision, unknown views, or not one file for each
            picture.
    """

    image: Positional[Annotated[tuple[Path, ...], arg(metavar="IMAGE")]]
    category: str
    out: Path
    pose: tuple[Path, ...] = ()
    camera: tuple[Path, ...] = ()
    gripper: str = "panda"
    grasps: Path | None = None
    scene: Path | None = None
    mask: tuple[Path, ...] = ()
    box: tuple[float, ...] = ()
    execute: Path | None = None
    pose_sigma: tuple[float, ...] | None = None
    mass: tuple[float, ...] | None = None
    friction: tuple[float, ...] | None = None
    force: tuple[float, ...] | None = None
    refine_pose: RefinePose = True
    estimator: EstimatorName = "rgb"
    depth: tuple[Path, ...] = ()
    views: str = MOVED_CAMERA
    device: Device = "auto"
    precision: Precision = "auto"
    seed: Seed = 0

    def __post_init__(self):
        check_counts(self)
        EstimatorSettings(self.refine_pose, self.device, self.precision)
        check_views(self.views)
        _check_lengths(self)

    @property
    def given_sigma(self) -> PoseSigma | None:
        """How sure the pose is, as `transfer_grasps` takes it."""
        sigma: Any = self.pose_sigma  # whatever its length, `transfer_grasps` answers what is wrong with it
        return sigma[0] if sigma is not None and len(sigma) == 1 else sigma


def _check_lengths(settings: TransferSettings) -> None:
    """
    Raises:
        SettingsError: no picture, or not one file for each.
    """
    count = len(settings.image)
    if count == 0:
        raise SettingsError("names no picture", key="image", value=settings.image)
    if not settings.pose and (count > 1 or settings.execute is not None):
        why = "of several pictures" if count > 1 else "that the mesh stands at"
        raise SettingsError(f"needs the pose {why}", key="pose", fix="Give a pose file")
    for key, others in (("pose", (0, 1)), ("camera", (0, 1)), ("mask", (0,)), ("depth", (0,))):
        found = len(getattr(settings, key))
        if found not in (count, *others):
            raise SettingsError(f"must name {count}, one for each picture", key=key, value=f"{found} of them")
    if len(settings.box) not in (0, 4 * count):
        raise SettingsError(f"must be {4 * count} numbers, four a picture", key="box", value=settings.box)


@dataclass(frozen=True)
class TransferInputs:
    """What the files of one object hold.

    Args:
        pictures: `image`, `pose`, `camera` and what else is given of each picture, lists where there are
            several, as `GraspTransfer.transfer` takes them.
        others: its other arguments.
        true_mesh: to execute the grasps on, or None.
    """

    pictures: dict[str, Any]
    others: dict[str, Any]
    true_mesh: trimesh.Trimesh | None


def read_inputs(settings: TransferSettings) -> TransferInputs:
    """Read every file that the settings name.

    Raises:
        GraspTransferError: one of them is wrong.
    """
    count = len(settings.image)
    pictures = [_read_picture(settings, number) for number in range(count)]
    others = {
        "views": settings.views,
        "physics": Physics(settings.mass, settings.friction, settings.force),
        "scene": None if settings.scene is None else load_scene(settings.scene),
    }
    if 0 < len(settings.pose) < count and len({one["pose"].tobytes() for one in pictures}) == 1:
        fix = "Give one pose file for each, or one with an entry of each"
        raise SettingsError("holds one pose for several pictures", key="pose", path=settings.pose[0], fix=fix)
    together = {key: [one[key] for one in pictures] for key in pictures[0]}
    missing = [key for key, values in together.items() if all(value is None for value in values)]
    seen = together | dict.fromkeys(missing) if count > 1 else pictures[0]
    true_mesh = None if settings.execute is None else load_mesh(settings.execute)
    return TransferInputs(seen, others, true_mesh)


def _read_picture(settings: TransferSettings, number: int) -> dict[str, Any]:
    """One picture, and what is given of it."""
    image = settings.image[number]
    pixels, pose = read_image(image), _of(settings.pose, number)
    given = None if pose is None else read_pose(pose, image=image)
    camera, mask, depth = (_of(files, number) for files in (settings.camera, settings.mask, settings.depth))
    return {
        "image": pixels,
        "pose": given and given.camera_from_object,
        "camera": camera_of(image, camera, *pixels.shape[1::-1]),
        "pose_sigma": given and given.pose_sigma if settings.pose_sigma is None else settings.given_sigma,
        "box": settings.box[4 * number : 4 * number + 4] or (given and given.box),
        "mask": None if mask is None else load_mask(mask),
        "depth": None if depth is None else load_depth(depth),
    }


def _of(files: tuple[Path, ...], number: int) -> Any:
    """The file of this picture; one serves all, and without any there is none."""
    return files[number if len(files) > 1 else 0] if len(files) else None


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
