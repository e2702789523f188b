"""Pinhole camera in OpenCV convention, without distortion."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import CameraError
from grasptransfer.files import read_yaml

WIDEST = 20.0  # picture widths to a focal length, 169 degrees: no lens without distortion sees more


@dataclass(frozen=True)
class Camera:
    """Pinhole intrinsics in pixels; (0, 0) is the centre of the top-left pixel.

    Args:
        fx, fy: focal lengths [px].
        cx, cy: principal point [px].
        width, height: picture size [px].
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float | np.number)
                or not np.isfinite(value)
            ):
                raise CameraError("must be a finite number", key=field.name, value=value)
            object.__setattr__(self, field.name, float(value))  # plain, so that YAML can write it
        for name in ("fx", "fy", "width", "height"):
            if getattr(self, name) <= 0:
                raise CameraError("must be positive", key=name, value=getattr(self, name))
        for name in ("width", "height"):
            if getattr(self, name) != int(getattr(self, name)):
                raise CameraError("must be a whole number of pixels", key=name, value=getattr(self, name))
            object.__setattr__(self, name, int(getattr(self, name)))

    @staticmethod
    def from_fov(width: int, height: int, horizontal_fov: float) -> "Camera":
        """Centred camera with square pixels.

        Args:
            width, height: of the picture [px].
            horizontal_fov: radians between the outer edges of the first and last column.

        Raises:
            CameraError: an angle that no picture has.
        """
        if not 0 < horizontal_fov < np.pi:
            raise CameraError("must lie between 0 and pi radians", key="horizontal_fov", value=horizontal_fov)
        focal = width / 2 / np.tan(horizontal_fov / 2)
        return Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    @staticmethod
    def from_matrix(matrix: object, width: int, height: int) -> "Camera":
        """Camera of a 3x3 intrinsic matrix [px].

        Raises:
            CameraError: another shape, not finite, transposed, with skew, or of a picture of size 1.
        """
        try:
            k = np.array(matrix, dtype=float)
        except (TypeError, ValueError) as error:
            raise CameraError("intrinsics must be a 3x3 matrix", key="camera", value=matrix) from error
        if k.shape != (3, 3):
            raise CameraError("intrinsics must be a 3x3 matrix", key="camera", value=k.shape)
        if not np.isfinite(k).all():
            raise CameraError("intrinsics must be finite", key="camera", value=k.tolist())
        if not np.allclose(k[2], [0, 0, 1]):
            fix = "Transpose it" if np.allclose(k[:, 2], [0, 0, 1]) else None
            raise CameraError("its last row must be 0, 0, 1", key="camera", value=k.tolist(), fix=fix)
        if abs(k[0, 1]) > 1e-6 or abs(k[1, 0]) > 1e-6:
            raise CameraError("intrinsics with skew are not supported", key="camera", value=k.tolist())
        if 0 < k[0, 0] < width / WIDEST:
            fix = "Are they in shares of the picture's size? Multiply by width and height"
            raise CameraError(
                "focal length is too short for pixels", key="camera", value=float(k[0, 0]), fix=fix
            )
        return Camera(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), width, height)

    @staticmethod
    def load(path: str | Path) -> "Camera":
        """Read a YAML or JSON camera file: `fx fy cx cy width height` [px], or BOP's `cam_K width height`.

        Raises:
            CameraError: unreadable, a key is missing or no number; names file and key.
        """
        path = Path(path)
        data = read_yaml(path, error=CameraError)
        names = [field.name for field in dataclasses.fields(Camera)]
        try:
            if "cam_K" in data:
                for name in ("width", "height"):
                    if name not in data:
                        raise CameraError("is missing", path=path, key=name)
                try:
                    k = np.array(data["cam_K"], dtype=float).reshape(3, 3)
                except (TypeError, ValueError) as error:
                    value = data["cam_K"]
                    raise CameraError("must hold 9 numbers", path=path, key="cam_K", value=value) from error
                return Camera.from_matrix(k, data["width"], data["height"])
            missing = [name for name in names if name not in data]
            if missing:
                raise CameraError("is missing", path=path, key=missing[0], choices=names)
            for name in names:
                if isinstance(data[name], bool) or not isinstance(data[name], int | float):
                    raise CameraError("must be a number", path=path, key=name, value=data[name])
            return Camera(**{name: data[name] for name in names})
        except CameraError as error:
            if error.path is not None:
                raise
            raise error.at(path) from error

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsic matrix K [px]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def project(self, points_camera: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*m 2"]:
        """Pixels (u, v) of points in the camera frame [m]; the caller keeps z > 0."""
        return points_camera[..., :2] / points_camera[..., 2:] * [self.fx, self.fy] + [self.cx, self.cy]

    def unproject(
        self, pixels: Float[np.ndarray, "*m 2"], depth: Float[np.ndarray, "*m"]
    ) -> Float[np.ndarray, "*m 3"]:
        """Points in the camera frame [m] of pixels (u, v) at `depth` [m] along the optical axis."""
        rays = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        return np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) * depth[..., None]

    def crop(self, box: tuple[float, float, float, float], width: int, height: int) -> "Camera":
        """Camera of the picture cut at `box` and resized to width x height.

        Args:
            box: (u0, v0, u1, v1), outer edges in pixels: the whole picture is
                (-0.5, -0.5, width - 0.5, height - 0.5).
        """
        u0, v0, u1, v1 = box
        su, sv = width / (u1 - u0), height / (v1 - v0)
        return Camera(
            self.fx * su, self.fy * sv, (self.cx - u0) * su - 0.5, (self.cy - v0) * sv - 0.5, width, height
        )
