"""Poses as they are given: read from a file, how sure they are, and whether they fit the picture."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.data_files import read_array, read_data
from grasptransfer.errors import NOT_NUMBERS, PoseError
from grasptransfer.frames import OPENGL_FROM_OPENCV, invert, rigid
from grasptransfer.picture_entries import entry_of
from grasptransfer.pose_formats import KEY, SIGMA, numbers_of, pose_of_mapping, pose_of_matrix

LOG = logging.getLogger(__name__)
NEAREST = 0.02  # m from the camera to the object's centre
BOX = "box"  # key of a pose file of ours
SIGMA_CHOICES = ("0", "[translation in m, rotation in degrees]", "a 6x6 covariance, turn then shift")

PoseSigma = float | tuple[float, float] | Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class PoseFile:
    """What a pose file says.

    Args:
        camera_from_object: (4, 4) OpenCV axes [m].
        pose_sigma: how sure the pose is, as `covariance_of` takes it; None where the file says nothing.
        convention: what was read, one phrase.
        box: (u0, v0, u1, v1) around the object [px], where the file has one.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    pose_sigma: PoseSigma | None
    convention: str
    box: tuple[float, float, float, float] | None = None


def load_pose(path: str | Path, *, image: str | Path | None = None) -> Float[np.ndarray, "4 4"]:
    """`camera_from_object` (4, 4) [m] of a pose file; `read_pose` also gives its uncertainty."""
    return read_pose(path, image=image).camera_from_object


def read_pose(path: str | Path, *, image: str | Path | None = None) -> PoseFile:
    """Read a pose file in any of the formats of `pose_formats`.

    Args:
        path: path of the file.
        image: the picture; its name selects the entry of a file of many pictures.

    Raises:
        PoseError: unreadable, no known format, or a mistake in it, named by file and key.
    """
    path = Path(path)
    array, box = read_array(path, error=PoseError), None
    data = read_data(path, error=PoseError) if array is None else None
    if data and isinstance(data, list) and all(isinstance(row, list) for row in data):
        array = numbers_of(data, "matrix", path)
    if array is not None:
        pose, sigma, convention = pose_of_matrix(array, path)
    else:
        entry = entry_of(data, path, image, error=PoseError)
        pose, sigma, convention = pose_of_mapping(entry, path)
        box = _box(entry.get(BOX), path)
    covariance_of(sigma, path=path)
    if not convention.startswith("our"):
        LOG.warning("%s was read as %s.", path, convention)
    return PoseFile(pose, _plain(sigma), convention, box)


def _box(value: Any, path: Path) -> tuple[float, float, float, float] | None:
    if value is None:
        return None
    whole = isinstance(value, list) and len(value) == 4
    if not whole or not all(type(side) in (int, float) and np.isfinite(side) for side in value):
        raise PoseError("must be [u0, v0, u1, v1] in pixels", path=path, key=BOX, value=value)
    return (float(value[0]), float(value[1]), float(value[2]), float(value[3]))


def _plain(sigma: Any) -> PoseSigma | None:
    """A list of YAML's as the pair or the matrix that it means."""
    if not isinstance(sigma, list):
        return sigma
    return np.array(sigma, float) if len(sigma) == 6 else (float(sigma[0]), float(sigma[1]))


def covariance_of(
    pose_sigma: object, *, key: str = SIGMA, path: Path | None = None
) -> Float[np.ndarray, "6 6"] | None:
    """Covariance of a pose error: turn [rad] about the object's origin, then shift [m], along camera axes.

    Args:
        pose_sigma: 0: the pose is exact; (translation [m], rotation [deg]): standard deviations along and
            about each axis; a (6, 6) covariance, turn then shift (`frames.drift`); None: nothing is known.
        key, path: place where it was given, for the error.

    Returns:
        (6, 6), or None where `pose_sigma` is None.

    Raises:
        PoseError: none of these, negative, in millimetres, or no covariance.
    """
    if pose_sigma is None:
        return None
    try:
        array = np.array(pose_sigma, dtype=float)
    except NOT_NUMBERS:
        array = np.array(np.nan)
    where: dict[str, Any] = {"key": key, "path": path, "value": pose_sigma}
    if (
        array.shape not in ((), (2,), (6, 6))
        or not np.isfinite(array).all()
        or (array.ndim == 0 and array != 0)
    ):
        raise PoseError("is no uncertainty of a pose", choices=SIGMA_CHOICES, **where)
    if array.ndim == 0:
        return np.zeros((6, 6))
    if array.ndim == 1:
        translation, degrees = array
        if translation < 0 or not 0 <= degrees <= 180:
            raise PoseError("must be metres of at least 0, and 0 to 180 degrees", **where)
        if translation > 1:
            raise PoseError("looks like millimetres, not metres", fix="Divide the first by 1000", **where)
        return np.diag([np.radians(degrees) ** 2] * 3 + [translation**2] * 3)
    if not np.allclose(array, array.T, atol=1e-9) or np.linalg.eigvalsh(array).min() < -1e-9:
        raise PoseError("is no covariance: it must be symmetric, without negative eigenvalues", **where)
    return (array + array.T) / 2


def check_in_view(camera_from_object: Float[np.ndarray, "4 4"], camera: Camera, *, key: str = "pose") -> None:
    """Refuse a pose that puts the object out of the picture, with the convention that would put it in.

    Raises:
        PoseError: the object lies behind the camera, or projects far outside the picture.
    """
    problem = _out_of_view(camera_from_object, camera)
    if problem is None:
        return
    others = {
        "object_from_camera": invert(camera_from_object),
        "OpenGL's (y up, z backwards)": OPENGL_FROM_OPENCV @ camera_from_object,
        "object_from_camera in OpenGL's axes": invert(camera_from_object @ OPENGL_FROM_OPENCV),
        "in metres, and was divided by 1000": _scaled(camera_from_object, 1000.0),
    }
    likely = [name for name, pose in others.items() if _out_of_view(pose, camera) is None]
    fix = "Axes are OpenCV's: x right, y down, z forward; lengths are metres"
    if likely:
        fix += f". The object would be in view if the pose were {' or '.join(likely)}"
    raise PoseError(problem[0], key=key, value=problem[1], fix=fix)


def _out_of_view(camera_from_object: Float[np.ndarray, "4 4"], camera: Camera) -> tuple[str, str] | None:
    """What is wrong, and the number that says so; None where the object is in view."""
    translation = camera_from_object[:3, 3]
    if translation[2] <= NEAREST:
        return "the object lies behind the camera or touches it", f"z = {translation[2]:.4g} m"
    u, v = camera.project(translation)
    # An object whose centre is off the picture by more than half of it cannot be seen well enough.
    if abs(u - camera.width / 2) < camera.width and abs(v - camera.height / 2) < camera.height:
        return None
    size = f"{camera.width} x {camera.height}"
    return f"the object projects outside the picture of {size}", f"pixel ({u:.0f}, {v:.0f})"


def _scaled(camera_from_object: Float[np.ndarray, "4 4"], factor: float) -> Float[np.ndarray, "4 4"]:
    return rigid(camera_from_object[:3, :3], factor * camera_from_object[:3, 3])


def pose_as_yaml(camera_from_object: Float[np.ndarray, "4 4"], pose_sigma: PoseSigma | None = None) -> dict:
    """The content of a pose file of ours, plain numbers."""
    data: dict[str, Any] = {KEY: np.asarray(camera_from_object).tolist()}
    if pose_sigma is not None:
        data[SIGMA] = np.asarray(pose_sigma, float).tolist()
    return data
