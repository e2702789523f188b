"""Each grasp drawn on the reconstruction, from a side that shows both fingers."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float, Float32, UInt8

from grasptransfer.frames import invert, transform_points
from grasptransfer.report.studio import Colour, Studio, View, fitted_view, painted, together

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper
    from grasptransfer.transfer import TransferredGrasp, TransferResult

PICTURE = (320, 260)  # px
SCOUT = (128, 104)  # px: pictures that only tell what hides what
USABLE: Colour = (46, 160, 67)
REFUSED: Colour = (214, 69, 48)
HAND: Colour = (120, 126, 136)
OBJECT: Colour = (196, 201, 208)
OBSTACLE: Colour = (150, 132, 110)
AZIMUTHS = np.deg2rad(np.arange(0, 360, 24))
ELEVATIONS = np.deg2rad([12, 38])
PLANE_RADIUS = 0.16  # m: the part of a support plane that is drawn
HIDDEN_BY = 0.002  # m that a point may lie behind the surface and still count as seen


@dataclass(frozen=True)
class _Scout:
    """A view from around the object and the depth of the bare object in it."""

    azimuth: float
    elevation: float
    view: View
    depth: Float32[np.ndarray, "h w"]


@dataclass(frozen=True)
class PaintedGripper:
    """Links of a gripper, ready to draw: those that carry a pad, and the rest."""

    fingers: list[trimesh.Trimesh]
    rest: list[trimesh.Trimesh]

    @property
    def parts(self) -> list[trimesh.Trimesh]:
        """Every link."""
        return [*self.fingers, *self.rest]


class GraspPictures:
    """Draws the grasps of one result.

    Args:
        result: of a transfer.
        studio: draws.
    """

    def __init__(self, result: "TransferResult", studio: Studio):
        self.result, self.studio = result, studio
        self.object = painted(result.mesh, OBJECT)
        self.surroundings = _surroundings(result)
        self.scouts = [self._scout(azimuth, elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
        to_camera = invert(result.camera_from_object)[:3, 3]
        self.observed_azimuth = float(np.arctan2(to_camera[1], to_camera[0]))

    def draw(self, grasp: "TransferredGrasp") -> UInt8[np.ndarray, "h w 3"]:
        """The opened gripper at the grasp: fingers green where it is usable, red where not."""
        colour = USABLE if grasp.usable else REFUSED
        gripper = painted_gripper(self.result.gripper, grasp.opening, grasp.object_from_gripper, colour)
        scout = max(self.scouts, key=lambda scout: self._clarity(scout, grasp))
        width, height = PICTURE
        # The hand may leave the picture: what matters is where the fingers are.
        framed = [self.object, *gripper.fingers]
        view = fitted_view(framed, scout.azimuth, scout.elevation, width=width, height=height, margin=1.35)
        return self.studio.draw(together([self.object, *gripper.parts, *self.surroundings]), view)

    def _scout(self, azimuth: float, elevation: float) -> _Scout:
        width, height = SCOUT
        view = fitted_view([self.object], azimuth, elevation, width=width, height=height, margin=2.5)
        depth = self.studio.renderer.depth(self.object, view.camera, view.camera_from_object)
        return _Scout(azimuth, elevation, view, depth)

    def _clarity(self, scout: _Scout, grasp: "TransferredGrasp") -> float:
        """How well a view shows the grasp: pads in sight, fingers side by side, near the photograph's."""
        object_from_camera = invert(scout.view.camera_from_object)
        to_camera = object_from_camera[:3, 3] / np.linalg.norm(object_from_camera[:3, 3])
        across = abs(float(to_camera @ grasp.object_from_gripper[:3, 1]))
        familiar = np.cos(scout.azimuth - self.observed_azimuth)
        seen = self._seen(scout, self._pad_points(grasp))
        return float(seen + 0.8 * across + 0.15 * familiar)

    def _pad_points(self, grasp: "TransferredGrasp") -> Float[np.ndarray, "m 3"]:
        pads = self.result.gripper.pad_centres(grasp.opening)
        # Points up the fingers, so that one sunk into the object still counts for what is in sight.
        steps = np.linspace(0, -0.03, 4)[:, None, None] * np.array([0.0, 0.0, 1.0])
        return transform_points(grasp.object_from_gripper, (pads + steps).reshape(-1, 3))

    @staticmethod
    def _seen(scout: _Scout, points: Float[np.ndarray, "m 3"]) -> float:
        """Share of the points that the bare object does not hide."""
        points_camera = transform_points(scout.view.camera_from_object, points)
        pixels = np.round(scout.view.camera.project(points_camera)).astype(int)
        height, width = scout.depth.shape
        u, v = np.clip(pixels[:, 0], 0, width - 1), np.clip(pixels[:, 1], 0, height - 1)
        surface = scout.depth[v, u]
        outside = (pixels[:, 0] != u) | (pixels[:, 1] != v)
        return float(np.mean(outside | (surface == 0) | (points_camera[:, 2] < surface + HIDDEN_BY)))


def painted_gripper(
    gripper: "Gripper", opening: float, a_from_gripper: Float[np.ndarray, "4 4"], colour: Colour
) -> PaintedGripper:
    """The gripper at a pose: what carries a pad in `colour`, the rest grey.

    Args:
        opening: distance between the pads [m].
        a_from_gripper: (4, 4) TCP [m].
    """
    pads = {pad.link for pad in gripper.pads}
    fingers, rest = [], []
    for name, mesh in gripper.link_meshes(float(np.clip(opening, *gripper.opening)), visual=True).items():
        mesh.apply_transform(a_from_gripper)
        if name in pads:
            fingers.append(painted(mesh, colour))
        else:
            rest.append(painted(mesh, HAND))
    return PaintedGripper(fingers, rest)


def _surroundings(result: "TransferResult") -> list[trimesh.Trimesh]:
    """Obstacles and the near part of the support plane, object frame."""
    if result.scene is None:
        return []
    object_from_camera = invert(result.camera_from_object)
    parts = []
    for _, mesh, camera_from_obstacle in result.scene.obstacles:
        moved = mesh.copy()
        moved.apply_transform(object_from_camera @ camera_from_obstacle)
        parts.append(painted(moved, OBSTACLE))
    if result.scene.support_plane is not None:
        point, normal = result.scene.support_plane
        normal = object_from_camera[:3, :3] @ normal
        height = normal @ transform_points(object_from_camera, point)
        disc = trimesh.creation.cylinder(PLANE_RADIUS, 0.002, sections=64)
        disc.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], normal))
        disc.apply_translation(normal * (height - 0.001))
        parts.append(painted(disc, OBSTACLE))
    return parts
