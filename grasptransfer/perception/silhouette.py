"""Fit of the reconstruction's outline to the predicted mask, as residuals for Gauss-Newton.

Points of the model that lie on its outline should be seen on the mask's border: the residual is the
signed distance to that border at the point's pixel. Where the network's flow is vague, the border of
its mask is sharp.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.ndimage import distance_transform_edt, map_coordinates

from grasptransfer.camera import Camera

BORDER_SCALE = 2.0  # px: Laplace scale of the predicted border's error
INDEPENDENT_POINTS = 30.0  # all outline points together count as this many independent ones
OUTLINE = 1.5  # px: how near to the model's own border a point counts as on it
HIDDEN = 4.0  # px: from here on, a point outside the mask is rather hidden by something than misplaced
FARTHEST = 30.0  # px: farther borders belong to something else, such as what hides the object

Drawn = Callable[[Float[np.ndarray, "v 3"], Float[np.ndarray, "4 4"]], Float[np.ndarray, "h w"]]


@dataclass(frozen=True)
class Silhouette:
    """The predicted mask as a signed distance picture.

    Args:
        probability: (hm, wm) that a cell of the zoomed picture shows the object.
        camera: of the zoomed picture.
        draw_depth: (vertices [m], pose) -> depth picture of the model with these vertices.
    """

    probability: Float[np.ndarray, "hm wm"]
    camera: Camera
    draw_depth: Drawn

    @cached_property
    def distance(self) -> Float[np.ndarray, "h w"]:
        """Signed distance to the mask's border [px], positive inside."""
        picture = Image.fromarray(self.probability.astype(np.float32))
        size = (self.camera.width, self.camera.height)
        return _signed_distance(np.asarray(picture.resize(size, Image.Resampling.BILINEAR)) > 0.5)

    @cached_property
    def slope(self) -> Float[np.ndarray, "2 h w"]:
        """Its derivative along u and v."""
        by_v, by_u = np.gradient(self.distance)
        return np.stack([by_u, by_v])

    @property
    def usable(self) -> bool:
        """Whether there is a border at all."""
        # Of a mask that is one faint cell, nothing is left at full size.
        return bool(np.isfinite(self.distance).all())

    def outline(self, vertices: Float[np.ndarray, "v 3"], pose: Float[np.ndarray, "4 4"]) -> np.ndarray:
        """Indices of the vertices (object frame [m]) that lie on the model's outline at this pose."""
        own = _signed_distance(self.draw_depth(vertices, pose) > 0)
        pixels = self.camera.project(vertices @ pose[:3, :3].T + pose[:3, 3])
        on_border = np.abs(_sample(own, pixels)) < OUTLINE
        inside = (pixels > 0).all(1) & (pixels < [self.camera.width - 1, self.camera.height - 1]).all(1)
        return np.nonzero(on_border & inside)[0]

    def residuals(
        self, pixels: Float[np.ndarray, "p 2"]
    ) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p 2"], Float[np.ndarray, "p"]]:
        """Distance to the mask's border, its derivative by the pixel, and the weight of its square.

        A point inside the mask is misplaced for certain; one outside may lie behind what stands before the
        object, and counts the less the farther out it lies.
        """
        distance = _sample(self.distance, pixels)
        slope = np.stack([_sample(self.slope[0], pixels), _sample(self.slope[1], pixels)], -1)
        weight = 1 / (BORDER_SCALE * np.sqrt(distance**2 + BORDER_SCALE**2))
        weight *= np.abs(distance) < FARTHEST
        weight /= 1 + (np.minimum(distance, 0) / HIDDEN) ** 2
        return distance, slope, weight * min(1.0, INDEPENDENT_POINTS / max(len(pixels), 1))


def _signed_distance(mask: np.ndarray) -> Float[np.ndarray, "h w"]:
    if mask.all() or not mask.any():
        return np.full(mask.shape, np.inf if mask.all() else -np.inf)
    inside, outside = np.asarray(distance_transform_edt(mask)), np.asarray(distance_transform_edt(~mask))
    return inside - outside - np.where(mask, 0.5, -0.5)


def _sample(picture: Float[np.ndarray, "h w"], pixels: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p"]:
    return map_coordinates(picture, [pixels[:, 1], pixels[:, 0]], order=1, mode="nearest")
