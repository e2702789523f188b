"""Pictures of a transfer: over the photograph, beside the canonical model, and what moved how far."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw
from scipy import ndimage

from grasptransfer.drawing.rendering import position_image
from grasptransfer.drawing.studio import (
    CANONICAL,
    LIGHTING,
    RECONSTRUCTION,
    Colour,
    Studio,
    View,
    crop_photo,
    hidden_view,
    observed_view,
    painted,
    together,
)

if TYPE_CHECKING:
    from grasptransfer.result import TransferResult

PANEL = (520, 390)  # px
PHOTO_WIDTH = 900  # px; a larger photograph is shown smaller
MASK: Colour = (226, 59, 128)
GIVEN: Colour = (245, 178, 66)
FOUND: Colour = (38, 196, 222)
HIDDEN_SHARE = 0.25  # how strongly the part of a gripper behind the object is drawn
LINE = 2.0  # px: half width of an outline's stroke
MAP = "coolwarm"  # diverging and readable with any colour vision
STEPS_MM = (1, 2, 5, 10, 15, 20, 30, 40, 50, 75, 100)  # ends of the colour scale

Picture = UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class DeformationMaps:
    """Displacement of the visible surface of the canonical model.

    Args:
        pictures: one for each axis x, y, z of the object frame.
        limit_mm: displacement at the ends of the colour scale.
        largest_mm: largest displacement of a visible point, per axis.
        colours: of the scale, from -limit to +limit.
    """

    pictures: tuple[Picture, Picture, Picture]
    limit_mm: float
    largest_mm: tuple[float, float, float]
    colours: tuple[Colour, ...]


class Pictures:
    """Draws the pictures of one result, each when asked for."""

    def __init__(self, result: "TransferResult", studio: Studio):
        self.result, self.studio = result, studio
        self.observation = result.observation

    @cached_property
    def canonical(self) -> trimesh.Trimesh:
        """The canonical model in its colour."""
        return painted(self.result.category.canonical, CANONICAL)

    @cached_property
    def reconstruction(self) -> trimesh.Trimesh:
        """The reconstruction in its colour."""
        return painted(self.result.mesh, RECONSTRUCTION)

    @cached_property
    def observed(self) -> View:
        """The photograph's own camera at the refined pose, zoomed to the object."""
        width, height = PANEL
        meshes = [self.canonical, self.reconstruction]
        return observed_view(
            self.observation.camera, self.result.camera_from_object, meshes, width=width, height=height
        )

    @cached_property
    def hidden(self) -> View:
        """The side that the photograph does not show."""
        width, height = PANEL
        meshes = [self.canonical, self.reconstruction]
        return hidden_view(self.result.camera_from_object, meshes, width=width, height=height)

    def photograph(self) -> Picture:
        """The whole photograph, with a frame around the part the other pictures show."""
        image = Image.fromarray(self.observation.image)
        scale = min(1.0, PHOTO_WIDTH / image.width)
        image = image.resize(
            (round(image.width * scale), round(image.height * scale)), Image.Resampling.LANCZOS
        )
        corners = np.array([[-0.5, -0.5], np.array(PANEL) - 0.5])
        rays = self.observed.camera.unproject(corners, np.ones(2))
        box = (self.observation.camera.project(rays) + 0.5) * scale
        draw = ImageDraw.Draw(image)
        draw.rectangle([tuple(corner) for corner in box], outline=(255, 255, 255), width=2)
        return np.asarray(image)

    def crop(self) -> Picture:
        """The part of the photograph with the object."""
        return crop_photo(self.observation.image, self.observation.camera, self.observed.camera)

    def mask(self) -> Picture | None:
        """The predicted pixels of the object, tinted; None where the estimator predicts none."""
        if self.result.mask is None:
            return None
        coverage = np.repeat(self.result.mask[..., None].astype(np.uint8) * 255, 3, axis=2)
        inside = crop_photo(coverage, self.observation.camera, self.observed.camera)[..., 0] > 127
        picture = self.crop().astype(float)
        picture[inside] = 0.5 * picture[inside] + 0.5 * np.array(MASK)
        return outlined(picture.astype(np.uint8), inside, MASK)

    def outlines(self) -> Picture:
        """Over the photograph: canonical model at the given pose, reconstruction at the refined one."""
        given = View(self.observed.camera, self.observation.camera_from_object)
        before = self.studio.mask(self.canonical, given)
        after = self.studio.mask(self.reconstruction, self.observed)
        return outlined(outlined(self.crop(), before, GIVEN), after, FOUND)

    def with_grippers(self, grippers: list[trimesh.Trimesh]) -> Picture:
        """Over the photograph: parts of grippers, object frame [m], pale where the object hides them."""
        width, height = PANEL
        camera, pose = self.observation.camera, self.result.camera_from_object
        view = observed_view(camera, pose, [self.reconstruction], width=width, height=height, margin=2.4)
        drawn = self.studio.renderer.render(together(grippers), view.camera, pose, lighting=LIGHTING)
        surface = self.studio.renderer.depth(self.reconstruction, view.camera, pose)
        hidden = (surface > 0) & (surface < drawn.depth)
        share = np.where(hidden, HIDDEN_SHARE, 1.0)[..., None]
        photo = crop_photo(self.observation.image, camera, view.camera)
        mixed = share * drawn.over(photo) + (1 - share) * photo
        return np.clip(np.round(mixed), 0, 255).astype(np.uint8)

    def sides(self) -> dict[str, tuple[Picture, Picture]]:
        """Canonical model and reconstruction, from the observed and from the hidden side."""
        both = (self.canonical, self.reconstruction)
        views = {"observed": self.observed, "hidden": self.hidden}
        drawn = {name: [self.studio.draw(mesh, view) for mesh in both] for name, view in views.items()}
        return {name: (pair[0], pair[1]) for name, pair in drawn.items()}

    def deformation(self) -> DeformationMaps:
        """How far each visible point of the canonical model moves (as Rodriguez et al. 2020, figure 7)."""
        from matplotlib import colormaps

        view = self.observed
        depth = self.studio.renderer.depth(self.canonical, view.camera, view.camera_from_object)
        visible = depth > 0
        points = position_image(depth, view.camera, view.camera_from_object)[visible].astype(float)
        moved_mm = 1e3 * self.result.field.displacement(points)
        limit = _limit(moved_mm)
        colour_map = colormaps[MAP]
        along_x, along_y, along_z = (
            _mapped(moved_mm[:, axis], visible, limit, colour_map) for axis in range(3)
        )
        x, y, z = (float(np.abs(moved_mm[:, axis]).max(initial=0.0)) for axis in range(3))
        colours = tuple(_rgb(colour) for colour in colour_map(np.linspace(0, 1, 11)))
        return DeformationMaps((along_x, along_y, along_z), limit, (x, y, z), colours)


def outlined(picture: Picture, inside: Bool[np.ndarray, "h w"], colour: Colour) -> Picture:
    """The picture with a smooth line around a region, dark-edged so that it shows on any ground."""
    if inside.all() or not inside.any():
        return picture
    outside, within = (np.asarray(ndimage.distance_transform_edt(part)) for part in (~inside, inside))
    signed = outside - within
    distance = np.abs(ndimage.gaussian_filter(signed, 1.0))
    drawn = picture.astype(float)
    for ink, half in (((20, 22, 26), LINE + 1), (colour, LINE)):
        share = np.clip(half + 0.5 - distance, 0, 1)[..., None] * (0.45 if ink != colour else 1)
        drawn = drawn * (1 - share) + share * np.array(ink)
    return np.clip(np.round(drawn), 0, 255).astype(np.uint8)


def _limit(moved_mm: Float[np.ndarray, "m 3"]) -> float:
    reached = float(np.percentile(np.abs(moved_mm), 99)) if len(moved_mm) else 0.0
    return float(next((step for step in STEPS_MM if step >= reached), STEPS_MM[-1]))


def _mapped(values, visible: Bool[np.ndarray, "h w"], limit: float, colour_map) -> Picture:
    picture = np.full((*visible.shape, 3), 255, np.uint8)
    shares = 0.5 + 0.5 * np.clip(values / limit, -1, 1)
    picture[visible] = np.round(255 * colour_map(shares)[:, :3]).astype(np.uint8)
    edge = visible ^ ndimage.binary_erosion(visible)
    picture[edge] = (90, 94, 102)
    return picture


def _rgb(colour) -> Colour:
    red, green, blue = (round(255 * channel) for channel in colour[:3])
    return red, green, blue
