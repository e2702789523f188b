"""Pinhole camera in OpenCV convention, without distortion."""

import dataclasses
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.camera_files import read_intrinsics
from grasptransfer.errors import NOT_NUMBERS, CameraError

LOG = logging.getLogger(__name__)
OFF_CENTRE = 0.15  # of a side; lenses are centred to a few percent, and a turned 4:3 picture is off by 17
OBLONG = 2.0  # sides of a pixel: analogue video had 1.1
ALIKE, NEAR_CORNER = 0.1, 0.05  # how well a guess at the reason must agree
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
            width, height: size of the picture [px].
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
            CameraError: another shape, not finite, transposed, with skew, or of another picture.
        """
        try:
            k = np.array(matrix, dtype=float)
        except NOT_NUMBERS as error:
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
        camera = Camera(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), width, height)
        camera.check_fits()
        return camera

    @staticmethod
    def load(
        path: str | Path, *, size: tuple[int, int] | None = None, image: str | Path | None = None
    ) -> "Camera":
        """Read a camera file; `camera_files` lists the formats. A photograph gives its EXIF focal length.

        Args:
            path: path of the file.
            size: width and height of the picture [px], for files that do not say it.
            image: the picture; its name selects the entry of a file of many pictures.

        Raises:
            CameraError: unreadable, of no known format, or of another picture; names file and key.
        """
        found = read_intrinsics(path, image=image)
        if not found.convention.startswith("our"):
            LOG.warning("%s was read as %s.", path, found.convention)
        size = found.size or size
        if size is None:
            fix = "Add width and height to it, or give size=(width, height)"
            raise CameraError("does not say the picture's size", path=path, key="width", fix=fix)
        try:
            return Camera.from_matrix(found.matrix, *size)
        except CameraError as error:
            raise error.at(path) from error

    def check_fits(self) -> None:
        """Refuse intrinsics that no whole picture of this size has; what `crop` gives may well have them.

        Raises:
            CameraError: the focal length or the principal point is another picture's, with the likely reason.
        """
        if self.fx < self.width / WIDEST:
            fix = "Are they in shares of the picture's size? Multiply by width and height"
            raise CameraError("focal length is too short for pixels", key="camera", value=self.fx, fix=fix)
        if not 1 / OBLONG < self.fx / self.fy < OBLONG:
            value = f"fx {self.fx:g}, fy {self.fy:g}"
            raise CameraError("focal lengths differ more than any pixel's sides", key="camera", value=value)
        middle = (self.width - 1) / 2, (self.height - 1) / 2
        off = abs(self.cx - middle[0]) / self.width, abs(self.cy - middle[1]) / self.height
        if max(off) > OFF_CENTRE:
            raise CameraError(
                f"principal point lies far from the middle of a picture of {self.width} x {self.height}",
                key="camera",
                value=f"cx {self.cx:g}, cy {self.cy:g}",
                fix=self._likely(middle),
            )

    def _likely(self, middle: tuple[float, float]) -> str:
        """Why the principal point may be where it is."""
        if abs(self.cx) < NEAR_CORNER * self.width and abs(self.cy) < NEAR_CORNER * self.height:
            return f"Is it measured from the middle? Add {middle[0]:g} and {middle[1]:g}"
        if np.allclose([self.cx, self.cy], middle[::-1], rtol=ALIKE):
            return "They are those of the picture turned by 90 degrees: turn one of them"
        factors = self.width / (2 * self.cx + 1), self.height / (2 * self.cy + 1)
        if min(factors) > 0 and abs(factors[0] / factors[1] - 1) < ALIKE:
            of = f"{2 * self.cx + 1:.0f} x {2 * self.cy + 1:.0f}"
            return f"They are those of a picture of about {of}: multiply them by {np.mean(factors):.4g}"
        return "Was the picture cut out of a larger one? Give that one's Camera(...).crop(box, width, height)"

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

    def resized(self, width: int, height: int) -> "Camera":
        """Camera of the whole picture resized to width x height."""
        return self.crop((-0.5, -0.5, self.width - 0.5, self.height - 0.5), width, height)

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
