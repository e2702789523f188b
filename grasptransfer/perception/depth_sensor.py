"""What a depth camera would report of a scene with glass: noise, holes, and depth of what lies behind.

Facts the model rests on:
- Active stereo (RealSense D400) finds disparity to about a tenth of a pixel, so its error grows with the
  square of the distance: sigma_z = z^2 sigma_d / (f b), baseline b = 50 mm (D435). Intel, *Tuning depth
  cameras for best performance*; the same law for the Kinect: Khoshelham and Oude Elberink, *Accuracy and
  Resolution of Kinect Depth Data*, Sensors 2012. Errors of neighbouring pixels, matched by one window, go
  together.
- On transparent objects depth is missing (the reflection of the projector is specular), or it is that of
  the surface behind, distorted by refraction: Sajjan et al., *ClearGrasp*, ICRA 2020; that the Kinect sees
  holes there: Lysenkov, Eruhimov, Bradski, RSS 2012; D415, SR305 and L515 compared on translucent matter:
  Sensors 2022, 22(19), 7378. Which of the two happens changes over patches, not from pixel to pixel.
- Flat refraction brings what lies behind a slab of thickness t nearer by t (1 - 1/n) (Snell, small angles);
  a full bottle is a lens besides, which no window matches: more holes.
- Slanted surfaces reflect the pattern away, and windows at a border see two depths: holes there as well.

Left out: the shadow beside near objects, multi-path, sunlight. They harm opaque objects as much.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.stats import norm

from grasptransfer.camera import Camera
from grasptransfer.errors import SettingsError


@dataclass(frozen=True)
class DepthSensor:
    """An active stereo camera; the defaults are those of a RealSense D435.

    Args:
        baseline: between its two eyes [m].
        subpixel: standard deviation of the disparity [px].
        window: side of the matching window: how far errors go together [px].
        patch: size of the patches in which glass fails in one way [px].
        through: share of the see-through pixels, where the glass itself is not measured, that give the
            depth of what lies behind; the others give none.
        refraction: index of what the transparent object is filled with; 1.33 is water, 1 an empty one.
        slant: largest angle between surface and line of sight's normal that is still measured [rad].
    """

    baseline: float = 0.050
    subpixel: float = 0.08
    window: float = 3.0
    patch: float = 8.0
    through: float = 0.5
    refraction: float = 1.33
    slant: float = np.deg2rad(78.0)

    def __post_init__(self):
        for name, low, high in (("baseline", 1e-3, 1.0), ("through", 0.0, 1.0), ("refraction", 1.0, 3.0)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise SettingsError(f"must lie between {low:g} and {high:g}", key=name, value=value)

    def measure(
        self,
        depth: Float[np.ndarray, "h w"],
        coverage: Float[np.ndarray, "h w"],
        behind: Float[np.ndarray, "h w"],
        *,
        camera: Camera,
        rng: np.random.Generator,
        path: Float[np.ndarray, "h w"] | None = None,
    ) -> Float[np.ndarray, "h w"]:
        """The depth picture it would report [m], 0 where it reports none.

        Args:
            depth: depth of the object's first surface [m], 0 where there is no object.
            coverage: opacity of the object there, in [0, 1]; below 1 light passes through.
            behind: depth of the scene without the object [m].
            path: length of the way through the object [m]; None: no refraction.
        """
        on_object = depth > 0
        own, seen_through = self._outcomes(coverage, rng)
        bent = behind if path is None else behind - path * (1 - 1 / self.refraction)
        surface = np.where(on_object & own, depth, np.where(on_object & seen_through, bent, 0.0))
        surface = np.where(on_object, surface, behind)
        surface = np.where(_slanted(depth, camera, self.slant) & on_object & own, 0.0, surface)
        surface = np.where(_on_step(surface), 0.0, surface)
        return np.where(surface > 0, self._noisy(surface, camera, rng), 0.0)

    def _outcomes(self, coverage, rng) -> tuple[np.ndarray, np.ndarray]:
        """Where the object's surface is measured, and where what lies behind it is."""
        own = _uniform_field(coverage.shape, self.patch, rng) < coverage
        return own, ~own & (_uniform_field(coverage.shape, self.patch, rng) < self.through)

    def _noisy(self, surface, camera: Camera, rng) -> Float[np.ndarray, "h w"]:
        disparity = camera.fx * self.baseline / np.maximum(surface, 1e-6)
        error = norm.ppf(_uniform_field(surface.shape, self.window / 2, rng)) * self.subpixel
        return camera.fx * self.baseline / np.maximum(disparity + error, 1e-3)


def wall_behind(
    camera: Camera, distance: float, *, tilt: float = 0.0, turn: float = 0.0
) -> Float[np.ndarray, "h w"]:
    """Depth of a plane that crosses the optical axis at `distance` [m].

    Args:
        tilt: angle of the plane out of the picture plane [rad].
        turn: direction of the tilt in the picture [rad].
    """
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([u, v], -1).astype(float), np.ones(u.shape))
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    # A ray that runs along the plane meets it far away.
    return distance * normal[2] / np.maximum(rays @ normal, 0.05)


def _uniform_field(shape: tuple[int, int], size: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Random numbers, each uniform in (0, 1), that change over `size` pixels."""
    smooth = gaussian_filter(rng.standard_normal(shape), size, mode="wrap")
    # The filtered noise has this standard deviation, whatever the picture.
    impulse = np.zeros(shape)
    impulse[0, 0] = 1.0
    deviation = np.sqrt(np.square(gaussian_filter(impulse, size, mode="wrap")).sum())
    return np.clip(norm.cdf(smooth / deviation), 1e-6, 1 - 1e-6)


def _slanted(depth, camera: Camera, limit: float) -> np.ndarray:
    """Where the first surface turns away from the line of sight by more than `limit`."""
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    points = camera.unproject(np.stack([u, v], -1).astype(float), depth.astype(float))
    along_v, along_u = np.gradient(points, axis=(0, 1))
    normals = np.cross(along_u, along_v)
    cosine = np.abs((normals * points).sum(-1))
    cosine /= np.maximum(np.linalg.norm(normals, axis=-1) * np.linalg.norm(points, axis=-1), 1e-12)
    return cosine < np.cos(limit)


def _on_step(surface: Float[np.ndarray, "h w"]) -> np.ndarray:
    """Where a small window sees two depths."""
    far = np.where(surface > 0, surface, np.inf)
    return maximum_filter(surface, 3) - minimum_filter(far, 3) > 0.05 * np.maximum(surface, 1e-6)
