"""From the keys of a request to the arguments of a transfer: checked, and never a path of the server's.

| key of `infer` | value |
| --- | --- |
| image | bytes of a JPEG or PNG file, or an array uint8 (h, w, 3) RGB |
| pose | (4, 4) `camera_from_object`, OpenCV axes [m] |
| category, gripper | names that `metadata` lists |
| camera | [fx, fy, cx, cy] [px], or (3, 3) intrinsics; none: 60 degrees horizontal field of view |
| box, mask, depth | as of `transfer_grasps`; mask and depth as arrays |
| scene | `obstacles`: name -> (box, or vertices and faces; camera_from_obstacle); `support_plane`, `stands` |
| estimator, pose_sigma, refine_pose, world_from_camera, seed | as of `transfer_grasps` |
| mesh | true: the answer also holds vertices and faces of the reconstruction |

An array is a mapping `{dtype, shape, data}`, or nested lists.
"""

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.errors import NOT_NUMBERS, GraspTransferError, ImageError, SceneError, SettingsError

if TYPE_CHECKING:
    from grasptransfer.grasping import Scene

DTYPES = ("bool", "uint8", "uint16", "int32", "int64", "float32", "float64")
MOST_PIXELS = 50_000_000  # of a picture; a small file may hold a picture that fills the memory
ACTIONS = ("health", "metadata", "infer")
REQUIRED = ("image", "pose", "category")
OPTIONAL = (
    "camera",
    "gripper",
    "box",
    "mask",
    "depth",
    "scene",
    "estimator",
    "pose_sigma",
    "refine_pose",
    "world_from_camera",
    "seed",
    "mesh",
)


def check_keys(given: Mapping, known: Sequence[str], required: Sequence[str], name: str) -> None:
    """
    Raises:
        SettingsError: a key is missing or unknown.
    """
    for key in given:
        if key not in known:
            raise SettingsError("is no key of this request", key=f"{name}.{key}", choices=known)
    for key in required:
        if given.get(key) is None:
            raise SettingsError("is missing", key=f"{name}.{key}", choices=known)


def array(value: Any, key: str) -> np.ndarray:
    """An array of `{dtype, shape, data}` or of nested lists.

    Raises:
        SettingsError: it is neither, or its bytes do not fill its shape.
    """
    if not isinstance(value, Mapping):
        try:
            return np.array(value, dtype=float)
        except NOT_NUMBERS as error:
            raise SettingsError("is not an array of numbers", key=key, value=value) from error
    check_keys(value, ("dtype", "shape", "data"), ("dtype", "shape", "data"), key)
    dtype, shape, data = value["dtype"], value["shape"], value["data"]
    if dtype not in DTYPES:
        raise SettingsError("unknown type of numbers", key=f"{key}.dtype", value=dtype, choices=DTYPES)
    whole = isinstance(shape, list) and all(type(side) is int and side >= 0 for side in shape)
    if not whole or not isinstance(data, bytes):
        raise SettingsError("must be a list of sizes and bytes that fill them", key=key, value=shape)
    if np.prod(shape, dtype=object) * np.dtype(dtype).itemsize != len(data):
        raise SettingsError(f"{len(data)} bytes do not fill shape {shape} of {dtype}", key=key)
    return np.frombuffer(data, dtype).reshape(shape)


def picture(value: Any) -> np.ndarray:
    """RGB picture of a file's bytes or of an array.

    Raises:
        ImageError: bytes that are no picture, or one too large.
    """
    if not isinstance(value, bytes):
        return array(value, "image")
    try:
        with Image.open(io.BytesIO(value)) as image:
            if image.width * image.height > MOST_PIXELS:
                raise ImageError(
                    f"has more than {MOST_PIXELS:,} pixels", key="image", value=(image.width, image.height)
                )
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError) as error:
        if isinstance(error, GraspTransferError):
            raise
        raise ImageError(
            "is no picture that can be read", key="image", value=f"{len(value)} bytes"
        ) from error


def camera_of(value: Any, width: int, height: int) -> Camera | None:
    """Camera of [fx, fy, cx, cy] or 3x3 intrinsics, for a picture of this size.

    Raises:
        CameraError, SettingsError: neither of them.
    """
    if value is None:
        return None
    numbers = array(value, "camera")
    if numbers.shape == (4,):
        fx, fy, cx, cy = (float(number) for number in numbers)
        return Camera(fx, fy, cx, cy, width, height)
    return Camera.from_matrix(numbers, width, height)


def scene_of(value: Any) -> "Scene | None":
    """Scene of a request.

    Raises:
        SceneError, SettingsError: a mistake in it, named by its key.
    """
    from grasptransfer.grasping import Scene

    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise SceneError("must be a mapping", key="scene", value=type(value).__name__)
    check_keys(value, ("obstacles", "support_plane", "stands"), (), "scene")
    obstacles = value.get("obstacles") or {}
    if not isinstance(obstacles, Mapping):
        raise SceneError("must map names to obstacles", key="scene.obstacles", value=type(obstacles).__name__)
    plane = value.get("support_plane")
    if plane is not None:
        if not isinstance(plane, Mapping):
            raise SceneError("must hold point and normal", key="scene.support_plane", value=plane)
        check_keys(plane, ("point", "normal"), ("point", "normal"), "scene.support_plane")
        plane = (array(plane["point"], "scene.support_plane"), array(plane["normal"], "scene.support_plane"))
    stands = value.get("stands", False)
    if not isinstance(stands, bool):
        raise SceneError("must be true or false", key="scene.stands", value=stands)
    return Scene(tuple(_obstacle(str(name), one) for name, one in obstacles.items()), plane, stands)


def _obstacle(name: str, value: Any) -> tuple[str, Any, np.ndarray]:
    import trimesh

    key = f"scene.obstacles.{name}"
    if not isinstance(value, Mapping):
        raise SceneError("must be a mapping", key=key, value=type(value).__name__)
    check_keys(value, ("box", "vertices", "faces", "camera_from_obstacle"), ("camera_from_obstacle",), key)
    pose = array(value["camera_from_obstacle"], f"{key}.camera_from_obstacle")
    if value.get("box") is not None:
        extents = array(value["box"], f"{key}.box")
        if extents.shape != (3,) or not (np.isfinite(extents).all() and (extents > 0).all()):
            raise SceneError("must be three positive lengths [m]", key=f"{key}.box", value=value["box"])
        return name, trimesh.creation.box(extents=extents), pose
    check_keys(value, ("vertices", "faces", "camera_from_obstacle"), ("vertices", "faces"), key)
    vertices, faces = (array(value[part], f"{key}.{part}") for part in ("vertices", "faces"))
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise SceneError(
            "must be (v, 3) vertices and (f, 3) faces", key=key, value=(vertices.shape, faces.shape)
        )
    faces = faces.astype(int)
    if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        raise SceneError("has faces that name no vertex, or none", key=f"{key}.faces", value=len(faces))
    return name, trimesh.Trimesh(vertices, faces, process=False), pose
