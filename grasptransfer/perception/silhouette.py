"""Fit of the reconstruction's outline to the predicted mask, as residuals for Gauss-Newton.

Where the network's flow is vague, the border of its mask is sharp. Points of the model that lie on its
outline should be seen on that border, and each point of the border should be met by one of the model's:
the one alone leaves parts of the mask uncovered that no outline is near, the other parts of the model
outside it. A residual is a signed distance to the border, positive inside.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit
from PIL import Image
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from grasptransfer.camera import Camera

BORDER_SCALE = 2.0  # px: Laplace scale of the predicted border's error
INDEPENDENT_POINTS = 30.0  # all points of the outline count as this many independent ones, the border's too
BORDER_POINTS = 200  # about so many of the mask's border are looked at
OUTLINE = 1.5  # px: how near to the model's own border a point counts as on it
AROUND = 4  # px within which borders are looked for: whose corners lie farther from one is not on it
HIDDEN = 4.0  # px: from here on, a point outside the mask is rather hidden by something than misplaced
FARTHEST = 30.0  # px: farther borders belong to something else, such as what hides the object

# Distances [px], their derivatives by the pixel, and the weights of their squares.
Residuals = tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p 2"], Float[np.ndarray, "p"]]
Drawn = Callable[[Float[np.ndarray, "v 3"], Float[np.ndarray, "4 4"]], Bool[np.ndarray, "h w"]]


@dataclass(frozen=True)
class Silhouette:
    """The predicted mask as a signed distance picture.

    Args:
        probability: (hm, wm) that a cell of the zoomed picture shows the object.
        camera: camera of the zoomed picture.
        draw: (vertices [m], pose) -> which pixels show the model with these vertices.
    """

    probability: Float[np.ndarray, "hm wm"]
    camera: Camera
    draw: Drawn

    @cached_property
    def distance(self) -> Float[np.ndarray, "h w"]:
        """Signed distance to the mask's border [px], positive inside."""
        picture = Image.fromarray(self.probability.astype(np.float32))
        size = (self.camera.width, self.camera.height)
        return _signed_distance(np.asarray(picture.resize(size, Image.Resampling.BILINEAR)) > 0.5)

    @cached_property
    def slope(self) -> Float[np.ndarray, "h w 2"]:
        """Its derivative along u and v."""
        by_v, by_u = np.gradient(self.distance)
        return np.stack([by_u, by_v], axis=-1)

    @cached_property
    def distance_and_slope(self) -> Float[np.ndarray, "h w 3"]:
        """Both, one behind the other for each pixel: they are sampled together."""
        return np.concatenate([self.distance[..., None], self.slope], axis=-1)

    @property
    def usable(self) -> bool:
        """Whether there is a border at all."""
        # Of a mask that is one faint cell, nothing is left at full size.
        return bool(np.isfinite(self.distance).all())

    def meetings(self, vertices: Float[np.ndarray, "v 3"], pose: Float[np.ndarray, "4 4"]) -> "Meetings":
        """Which of the model's vertices (object frame [m]) are to meet the mask's border at this pose."""
        pixels = self.camera.project(vertices @ pose[:3, :3].T + pose[:3, 3])
        outline = np.nonzero(_on_outline(self.draw(vertices, pose), pixels))[0]
        nearest, border = self._nearest_to_border(pixels[outline])
        return Meetings(self, np.concatenate([outline, outline[nearest]]), border)

    def _nearest_to_border(
        self, pixels: Float[np.ndarray, "p 2"]
    ) -> tuple[Int[np.ndarray, "q"], Int[np.ndarray, "q"]]:
        """For each point of the mask's border the nearest of these pixels: indices of both."""
        border, _ = self.border
        if len(pixels) == 0 or len(border) == 0:
            return np.zeros(0, int), np.zeros(0, int)
        apart, nearest = KDTree(pixels).query(border)
        near = np.nonzero(apart < FARTHEST)[0]
        return np.asarray(nearest)[near], near

    @cached_property
    def border(self) -> tuple[Float[np.ndarray, "p 2"], Float[np.ndarray, "p 2"]]:
        """Pixels on the mask's border, and their unit normals into the mask.

        Where the mask goes on beyond the picture, there is none.
        """
        v, u = np.nonzero((self.distance > 0) & (self.distance < 1))
        pixels = np.stack([u, v], -1)[:: max(1, len(u) // BORDER_POINTS)].astype(float)
        sampled = _sampled(self.distance_and_slope, pixels)
        normals = sampled[:, 1:] / np.maximum(np.linalg.norm(sampled[:, 1:], axis=1, keepdims=True), 1e-6)
        return pixels - sampled[:, :1] * normals, normals

    def residuals(self, pixels: Float[np.ndarray, "p 2"]) -> Residuals:
        """Of outline points seen at these pixels: distance to the mask's border."""
        sampled = _sampled(self.distance_and_slope, pixels)
        distance = sampled[:, 0]
        return distance, sampled[:, 1:], _weight(distance) * (np.abs(distance) < FARTHEST)

    def residuals_of_border(
        self, pixels: Float[np.ndarray, "q 2"], points: Int[np.ndarray, "q"]
    ) -> Residuals:
        """Of these points of the mask's border, met by model points seen at these pixels."""
        border, normals = (part[points] for part in self.border)
        distance = np.sum((pixels - border) * normals, axis=1)
        return distance, normals, _weight(distance)


@dataclass(frozen=True)
class Meetings:
    """Vertices of the model, and where on the mask's border they are to be seen.

    Args:
        vertices: indices; those on the model's outline, which meet the border anywhere, come first.
        border: of the others: indices of the border points that they are the nearest to.
    """

    silhouette: Silhouette
    vertices: Int[np.ndarray, "b"]
    border: Int[np.ndarray, "q"]

    def residuals(self, pixels: Float[np.ndarray, "b 2"]) -> Residuals:
        """Of the vertices seen at these pixels."""
        anywhere = len(self.vertices) - len(self.border)
        outer = self.silhouette.residuals(pixels[:anywhere])
        inner = self.silhouette.residuals_of_border(pixels[anywhere:], self.border)
        distance, slope, weight = (np.concatenate(parts) for parts in zip(outer, inner, strict=True))
        return distance, slope, weight


def _weight(distance: Float[np.ndarray, "p"]) -> Float[np.ndarray, "p"]:
    """A point inside the mask is misplaced for certain.

    One outside may lie behind what stands before the object, and counts the less the farther out it is.
    """
    weight = 1 / (BORDER_SCALE * np.sqrt(distance**2 + BORDER_SCALE**2))
    weight /= 1 + (np.minimum(distance, 0) / HIDDEN) ** 2
    return weight * min(1.0, INDEPENDENT_POINTS / max(len(distance), 1))


def _signed_distance(mask: np.ndarray) -> Float[np.ndarray, "h w"]:
    if mask.all() or not mask.any():
        return np.full(mask.shape, np.inf if mask.all() else -np.inf)
    inside, outside = np.asarray(distance_transform_edt(mask)), np.asarray(distance_transform_edt(~mask))
    return inside - outside - np.where(mask, 0.5, -0.5)


def _on_outline(mask: Bool[np.ndarray, "h w"], pixels: Float[np.ndarray, "p 2"]) -> Bool[np.ndarray, "p"]:
    """Which of the pixels within the picture lie nearer than `OUTLINE` to the mask's border.

    As if sampled bilinearly from the signed distance, which is made only around each of them.
    """
    border = np.zeros(mask.shape, np.bool_)
    border[:, :-1] |= mask[:, :-1] != mask[:, 1:]
    border[:-1] |= mask[:-1] != mask[1:]
    found = np.zeros(len(pixels), np.bool_)
    _find_on_outline(mask, np.argwhere(border), pixels, np.zeros(mask.shape, np.bool_), found)
    return found


@njit(nogil=True, cache=True, error_model="numpy")
@no_type_check
def _find_on_outline(mask, border, pixels, around, found):
    """Mark in `found` those of the pixels that lie on the outline.

    Args:
        border: (q, 2) row and column of the pixels on the mask's border.
        around: (h, w) false everywhere; marks what lies near the border: most of the pixels do not.
    """
    height, width = mask.shape
    for i in range(len(border)):
        for v in range(max(0, border[i, 0] - AROUND), min(height, border[i, 0] + AROUND + 1)):
            for u in range(max(0, border[i, 1] - AROUND), min(width, border[i, 1] + AROUND + 1)):
                around[v, u] = True
    for i in range(len(pixels)):
        column, row = int(pixels[i, 0]), int(pixels[i, 1])
        right, down = pixels[i, 0] - column, pixels[i, 1] - row
        if not (pixels[i, 0] > 0 and pixels[i, 1] > 0 and column < width - 1 and row < height - 1):
            continue
        if not around[row, column]:
            continue
        distance = 0.0
        for corner in range(4):
            v, u = row + corner // 2, column + corner % 2
            own, least = mask[v, u], AROUND * AROUND
            for y in range(max(0, v - AROUND + 1), min(height, v + AROUND)):
                for x in range(max(0, u - AROUND + 1), min(width, u + AROUND)):
                    if mask[y, x] != own:
                        least = min(least, (y - v) ** 2 + (x - u) ** 2)
            inwards = np.sqrt(least) - 0.5 if own else 0.5 - np.sqrt(least)
            distance += (right if corner % 2 else 1 - right) * (down if corner // 2 else 1 - down) * inwards
        found[i] = abs(distance) < OUTLINE


def _sampled(
    picture: Float[np.ndarray, "h w c"], pixels: Float[np.ndarray, "p 2"]
) -> Float[np.ndarray, "p c"]:
    """The picture bilinearly at each place; beyond its border that of the border."""
    height, width, channels = picture.shape
    u, v = np.clip(pixels[:, 0], 0, width - 1), np.clip(pixels[:, 1], 0, height - 1)
    column, row = np.minimum(u.astype(int), width - 2), np.minimum(v.astype(int), height - 2)
    right, down = (u - column)[:, None], (v - row)[:, None]
    rows, first = picture.reshape(-1, channels), row * width + column
    above = rows[first] * (1 - right) + rows[first + 1] * right
    below = rows[first + width] * (1 - right) + rows[first + width + 1] * right
    return above * (1 - down) + below * down
