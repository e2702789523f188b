"""The camera files of calibration tools, drivers and datasets: from their content to intrinsics.

| file | content |
| --- | --- |
| ours | `fx fy cx cy width height` |
| RealSense intrinsics | `fx fy ppx ppy width height`, `coeffs` |
| BOP `camera.json`, `scene_camera.json` | `cam_K`: 9; or `fx fy cx cy`, `depth_scale` |
| ROS `camera_info` (message or calibration YAML) | `K` / `camera_matrix`, `P`, `D`, `width`, `image_width` |
| OpenCV `cv::FileStorage` | `camera_matrix: !!opencv-matrix`, `distortion_coefficients`, `image_width` |
| MegaPose `camera_data.json` | `K`, `resolution`: [height, width] |
| Open3D `PinholeCameraIntrinsic` | `intrinsic_matrix`: 9, column by column |
| Kalibr `camchain.yaml` | `cam0`: `intrinsics`: [fx, fy, cx, cy], `resolution`: [width, height] |
| `transforms.json` (NeRF) | `fl_x fl_y cx cy w h`, or `camera_angle_x w h`; first pixel's centre (0.5, 0.5) |
| text or `.npy` (FoundationPose, KITTI) | 3x3, or the 3x4 projection matrix P |
| a photograph | EXIF focal length, in 35 mm equivalent |
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, UnidentifiedImageError

from grasptransfer.data_files import read_array, read_data
from grasptransfer.errors import CameraError
from grasptransfer.exif import focal_length
from grasptransfer.picture_entries import entry_of

LOG = logging.getLogger(__name__)
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".heic")
STRAIGHT = 0.5  # px: distortion that moves no corner of the picture farther is left out in silence

Size = tuple[int, int]


@dataclass(frozen=True)
class Intrinsics:
    """What a camera file says.

    Args:
        matrix: (3, 3) K [px], (0, 0) the centre of the first pixel.
        size: width and height of the picture [px]; None where the file does not say.
        convention: what was read, one phrase.
    """

    matrix: Float[np.ndarray, "3 3"]
    size: Size | None
    convention: str


def read_intrinsics(path: str | Path, *, image: str | Path | None = None) -> Intrinsics:
    """Read a camera file in any of the formats of this module's table.

    Args:
        path: path of the file.
        image: the picture; its name selects the entry of a file of many pictures.

    Raises:
        CameraError: unreadable, no known format, or a mistake in it, named by file and key.
    """
    path = Path(path)
    if path.suffix.lower() in PICTURES:
        return _of_photograph(path)
    array = read_array(path, error=CameraError)
    if array is not None:
        return _of_array(array, path)
    data = read_data(path, error=CameraError)
    if data and isinstance(data, list) and all(isinstance(row, list) for row in data):
        return _of_array(_numbers(data, "matrix", path), path)
    if isinstance(data, dict) and isinstance(data.get("cam0"), dict):
        data = data["cam0"]
    data = entry_of(data, path, image, error=CameraError)
    found = [read for keys, read in READERS.items() if any(key in data for key in keys)]
    if not found:
        choices = ["fx fy cx cy width height", *(keys[0] for keys in READERS), "3x3 or 3x4 numbers"]
        raise CameraError("has no intrinsics", path=path, value=list(data)[:8], choices=choices)
    intrinsics = found[0](data, path)
    _warn_of_distortion(intrinsics, data, path)
    return intrinsics


def _ours(data: dict, path: Path) -> Intrinsics:
    names = ("fx", "fy", "ppx", "ppy") if "ppx" in data else ("fx", "fy", "cx", "cy")
    fx, fy, cx, cy = (_number(data, name, path, known=(*names, "width", "height")) for name in names)
    convention = "RealSense intrinsics" if "ppx" in data else "our fx fy cx cy"
    return Intrinsics(_matrix(fx, fy, cx, cy), _size(data, path), convention)


def _nerf(data: dict, path: Path) -> Intrinsics:
    """instant-ngp and nerfstudio measure from the first pixel's corner, half a pixel before its centre."""
    size = _size(data, path)
    if "fl_x" in data:
        fx = _number(data, "fl_x", path)
        fy = _number(data, "fl_y", path) if "fl_y" in data else fx
    else:
        if size is None:
            raise CameraError(
                "is missing", path=path, key="w", fix="Give width w and height h beside camera_angle_x"
            )
        fx = fy = size[0] / 2 / np.tan(_number(data, "camera_angle_x", path) / 2)
    if "cx" in data or size is None:
        cx, cy = _number(data, "cx", path), _number(data, "cy", path)
    else:
        cx, cy = size[0] / 2, size[1] / 2
    return Intrinsics(_matrix(fx, fy, cx - 0.5, cy - 0.5), size, "transforms.json")


def _with_matrix(data: dict, path: Path) -> Intrinsics:
    key = next(key for key in MATRICES if key in data)
    value = data[key]
    if isinstance(value, dict) and {"fx", "fy"} <= value.keys():
        return _ours(data | value, path)
    if isinstance(value, dict):  # rows, cols, data: ROS calibration files and OpenCV's
        value = value.get("data")
    array = _numbers(value, key, path, kind="9 numbers")
    if array.shape == (4,):
        return Intrinsics(_matrix(*array), _size(data, path), f"Kalibr's {key}: fx, fy, cx, cy")
    if array.size and not array.any():
        fix = "The driver has no calibration: calibrate the camera"
        raise CameraError("holds zeros only", path=path, key=key, fix=fix)
    if array.size == 12:
        return _of_projection(array.reshape(3, 4), key, path, _size(data, path))
    if array.size != 9 or (array.ndim == 2 and array.shape != (3, 3)):
        raise CameraError("must hold 9 numbers", path=path, key=key, value=data[key])
    matrix = array.reshape(3, 3)
    if key == "intrinsic_matrix" and array.ndim == 1 and matrix[2, 2] == 1 and matrix[2, :2].any():
        matrix = matrix.T  # Open3D writes column by column
    return Intrinsics(matrix, _size(data, path), f"{key}, a 3x3 matrix")


def _of_array(array: np.ndarray, path: Path) -> Intrinsics:
    if array.size == 9:
        return Intrinsics(array.reshape(3, 3), None, "a plain 3x3 matrix")
    if array.size == 12:
        return _of_projection(array.reshape(3, 4), "P", path, None)
    raise CameraError("must hold 3x3 numbers, or the 3x4 of P", path=path, value=array.shape)


def _of_projection(
    projection: Float[np.ndarray, "3 4"], key: str, path: Path, size: Size | None
) -> Intrinsics:
    """K of P = [K | K t], as ROS and KITTI write it; a camera that is turned has no K to read off."""
    matrix = projection[:, :3]
    if np.abs(matrix[2] - [0, 0, 1]).max() > 1e-6 or abs(matrix[1, 0]) > 1e-6:
        raise CameraError(
            "holds the camera's pose besides its intrinsics",
            path=path,
            key=key,
            fix="Give K, the 3x3 intrinsics",
        )
    if np.abs(projection[:, 3]).max() > 1e-6:
        LOG.warning("%s: its last column shifts the camera: poses must be in the frame of this camera.", path)
    return Intrinsics(matrix, size, f"{key}, a 3x4 projection matrix: its first three columns")


def _of_photograph(path: Path) -> Intrinsics:
    try:
        with Image.open(path) as picture:
            size, exif = picture.size, picture.getexif()
    except FileNotFoundError as error:
        raise CameraError("does not exist", path=path) from error
    except (UnidentifiedImageError, OSError, ValueError) as error:
        raise CameraError(f"cannot be read as a picture: {error}", path=path) from error
    found = focal_length(exif, size)
    if found is None:
        fix = "Give a camera file: fx fy cx cy width height, from a calibration"
        raise CameraError("is not a text file, and has no focal length in EXIF data", path=path, fix=fix)
    focal, convention = found
    return Intrinsics(_matrix(focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2), size, convention)


def _warn_of_distortion(intrinsics: Intrinsics, data: dict, path: Path) -> None:
    """Say by how much the pinhole camera misses a lens with these coefficients of OpenCV's model."""
    value = next((data[key] for key in DISTORTIONS if key in data), None)
    value = value.get("data") if isinstance(value, dict) else value
    if value is None:
        value = [data.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3")]
    coefficients = _numbers(value, "distortion", path).ravel()
    matrix = intrinsics.matrix
    size = intrinsics.size or (int(2 * matrix[0, 2] + 1), int(2 * matrix[1, 2] + 1))
    moved = _distortion(coefficients, matrix, size)
    if moved > STRAIGHT:
        LOG.warning(
            "%s: the lens bends the picture by up to %.0f pixels, which a pinhole camera leaves out. "
            "Undistort the picture first (rectify it), and give the camera of the result.",
            path,
            moved,
        )


def _distortion(coefficients: Float[np.ndarray, "d"], matrix: Float[np.ndarray, "3 3"], size: Size) -> float:
    """Farthest shift [px] of a corner of the picture by k1, k2, p1, p2, k3 (OpenCV's order and model)."""
    k1, k2, p1, p2, k3 = np.concatenate([coefficients, np.zeros(5)])[:5]
    corners = np.array([[0, 0], [size[0], 0], [0, size[1]], list(size)], float)
    x, y = ((corners - matrix[:2, 2]) / np.diag(matrix)[:2]).T
    r2 = x**2 + y**2
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    shift = [
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    ]
    return float(np.hypot(matrix[0, 0] * shift[0], matrix[1, 1] * shift[1]).max())


def _size(data: dict, path: Path) -> Size | None:
    """Width and height under any of the names in use."""
    if "resolution" in data:
        pair = _numbers(data["resolution"], "resolution", path)
        if pair.shape != (2,):
            raise CameraError("must hold 2 numbers", path=path, key="resolution", value=data["resolution"])
        width, height = pair if "intrinsics" in data else pair[::-1]  # Kalibr's order, MegaPose's
        return _whole(width, "resolution", path), _whole(height, "resolution", path)
    for width, height in SIZES:
        if width in data or height in data:
            return (
                _whole(_number(data, width, path), width, path),
                _whole(_number(data, height, path), height, path),
            )
    return None


def _whole(value: float, key: str, path: Path) -> int:
    if not np.isfinite(value) or value != int(value) or value <= 0:
        raise CameraError("must be a whole number of pixels", path=path, key=key, value=value)
    return int(value)


def _matrix(fx: float, fy: float, cx: float, cy: float) -> Float[np.ndarray, "3 3"]:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)


def _number(data: dict, key: str, path: Path, *, known: tuple[str, ...] | None = None) -> float:
    if key not in data:
        raise CameraError("is missing", path=path, key=key, choices=known)
    if isinstance(data[key], bool) or not isinstance(data[key], int | float):
        raise CameraError("must be a number", path=path, key=key, value=data[key])
    if abs(data[key]) > LARGEST_NUMBER:
        raise CameraError("is too large", path=path, key=key, value=data[key])
    return float(data[key])


def _numbers(value: object, key: str, path: Path, *, kind: str = "numbers") -> np.ndarray:
    try:
        array = np.array(value)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind not in "if":
        raise CameraError(f"must hold {kind}", path=path, key=key, value=value)
    return array.astype(float)


MATRICES = (
    "camera_matrix",
    "K",
    "k",
    "cam_K",
    "cameraMatrix",
    "Camera_Matrix",
    "intrinsic_matrix",
    "mtx",
    "intrinsics",
    "intrinsic",
    "camera_intrinsics",
    "P",
    "p",
    "projection_matrix",
)
DISTORTIONS = (
    "distortion_coefficients",
    "D",
    "d",
    "coeffs",
    "distortion_coeffs",
    "distCoeffs",
    "Distortion_Coefficients",
    "dist",
)
LARGEST_NUMBER = 1e9  # no focal length or side of a picture in pixels is larger
SIZES = (
    ("width", "height"),
    ("image_width", "image_height"),
    ("image_Width", "image_Height"),
    ("w", "h"),
)
READERS: dict[tuple[str, ...], Callable[[dict, Path], Intrinsics]] = {
    ("fx", "fy"): _ours,
    ("fl_x", "camera_angle_x"): _nerf,
    MATRICES: _with_matrix,
}
