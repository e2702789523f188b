"""Each grasp drawn on its object, from a side that shows both fingers."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
import trimesh
from jaxtyping import Float, Float32, UInt8

from grasptransfer.drawing.studio import Colour, Studio, View, fitted_view, painted, together
from grasptransfer.frames import invert, transform_points

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper, Scene
    from grasptransfer.result import TransferResult

PICTURE = (320, 260)  # px
SCOUT = (128, 104)  # px: pictures that only show what hides what
USABLE: Colour = (46, 160, 67)
REFUSED: Colour = (214, 69, 48)
HAND: Colour = (120, 126, 136)
OBJECT: Colour = (196, 201, 208)
OBSTACLE: Colour = (150, 132, 110)
AZIMUTHS = np.deg2rad(np.arange(0, 360, 24))
ELEVATIONS = np.deg2rad([12, 38])
PLANE_RADIUS = 0.16  # m: the part of a support plane that is drawn
FAMILIAR = np.deg2rad(40)  # azimuth that is preferred where no photograph gives one
HIDDEN_BY = 0.002  # m that a point may lie behind the surface and still count as seen


@dataclass(frozen=True)
class _Scout:
    """A view from around the object and the depth, without a gripper, in it."""

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


@runtime_checkable
class DrawnGrasp(Protocol):
    """What is asked of a grasp to draw it: a `TransferredGrasp`, or a `GraspToDraw`."""

    @property
    def name(self) -> str:
        """Written below its picture."""
        ...

    @property
    def object_from_gripper(self) -> Float[np.ndarray, "4 4"]:
        """TCP pose [m]."""
        ...

    @property
    def opening(self) -> float:
        """Distance between the pads on the way in [m]."""
        ...

    @property
    def usable(self) -> bool:
        """Whether its fingers are green."""
        ...


@dataclass(frozen=True)
class GraspToDraw:
    """A grasp to draw that comes from no transfer; see `DrawnGrasp`."""

    name: str
    object_from_gripper: Float[np.ndarray, "4 4"]
    opening: float
    usable: bool


class GraspPictures:
    """Draws grasps of one object.

    Args:
        mesh: the object, object frame [m].
        gripper: that grasps it.
        studio: draws.
        scene: what stands around the object, camera frame.
        camera_from_object: (4, 4) where the object was seen from [m]; None: no photograph.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        gripper: "Gripper",
        studio: Studio,
        *,
        scene: "Scene | None" = None,
        camera_from_object: Float[np.ndarray, "4 4"] | None = None,
    ):
        self.gripper, self.studio = gripper, studio
        self.object = painted(mesh, OBJECT)
        object_from_camera = np.eye(4) if camera_from_object is None else invert(camera_from_object)
        self.surroundings = surroundings(scene, object_from_camera)
        self.blocking = together([self.object, *self.surroundings])
        self.scouts = [self._scout(azimuth, elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
        to_camera = object_from_camera[:3, 3]
        photographed = camera_from_object is not None
        self.familiar = float(np.arctan2(to_camera[1], to_camera[0])) if photographed else FAMILIAR

    @staticmethod
    def of(result: "TransferResult", studio: Studio) -> "GraspPictures":
        """For the grasps of a transfer, on its reconstruction."""
        return GraspPictures(
            result.mesh,
            result.gripper,
            studio,
            scene=result.scene,
            camera_from_object=result.camera_from_object,
        )

    def draw(self, grasp: DrawnGrasp) -> UInt8[np.ndarray, "h w 3"]:
        """The opened gripper at the grasp: fingers green where it is usable, red where not."""
        colour = USABLE if grasp.usable else REFUSED
        gripper = painted_gripper(self.gripper, grasp.opening, grasp.object_from_gripper, colour)
        scout = max(self.scouts, key=lambda scout: self._clarity(scout, grasp))
        width, height = PICTURE
        # The hand may leave the picture: what matters is where the fingers are.
        framed = [self.object, *gripper.fingers]
        view = fitted_view(framed, scout.azimuth, scout.elevation, width=width, height=height, margin=1.35)
        return self.studio.draw(together([self.object, *gripper.parts, *self.surroundings]), view)

    def _scout(self, azimuth: float, elevation: float) -> _Scout:
        width, height = SCOUT
        view = fitted_view([self.object], azimuth, elevation, width=width, height=height, margin=2.5)
        depth = self.studio.renderer.depth(self.blocking, view.camera, view.camera_from_object)
        return _Scout(azimuth, elevation, view, depth)

    def _clarity(self, scout: _Scout, grasp: DrawnGrasp) -> float:
        """How well a view shows the grasp: pads in sight, fingers side by side, near the photograph's."""
        object_from_camera = invert(scout.view.camera_from_object)
        to_camera = object_from_camera[:3, 3] / np.linalg.norm(object_from_camera[:3, 3])
        across = abs(float(to_camera @ grasp.object_from_gripper[:3, 1]))
        familiar = np.cos(scout.azimuth - self.familiar)
        seen = self._seen(scout, self._pad_points(grasp))
        return float(seen + 0.8 * across + 0.15 * familiar)

    def _pad_points(self, grasp: DrawnGrasp) -> Float[np.ndarray, "m 3"]:
        pads = self.gripper.pad_centres(grasp.opening)
        # Points up the fingers, so that one sunk into the object still counts for what is in sight.
        steps = np.linspace(0, -0.03, 4)[:, None, None] * np.array([0.0, 0.0, 1.0])
        return transform_points(grasp.object_from_gripper, (pads + steps).reshape(-1, 3))

    @staticmethod
    def _seen(scout: _Scout, points: Float[np.ndarray, "m 3"]) -> float:
        """Share of the points that neither the object nor an obstacle hides."""
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
    pads = gripper.finger_links
    fingers, rest = [], []
    for name, mesh in gripper.link_meshes(float(np.clip(opening, *gripper.opening)), visual=True).items():
        mesh.apply_transform(a_from_gripper)
        if name in pads:
            fingers.append(painted(mesh, colour))
        else:
            rest.append(painted(mesh, HAND))
    return PaintedGripper(fingers, rest)


def surroundings(
    scene: "Scene | None", object_from_camera: Float[np.ndarray, "4 4"]
) -> list[trimesh.Trimesh]:
    """Obstacles and the near part of the support plane, object frame."""
    if scene is None:
        return []
    parts = []
    for _, mesh, camera_from_obstacle in scene.obstacles:
        moved = mesh.copy()
        moved.apply_transform(object_from_camera @ camera_from_obstacle)
        parts.append(painted(moved, OBSTACLE))
    if scene.support_plane is not None:
        point, normal = scene.support_plane
        normal = object_from_camera[:3, :3] @ normal
        height = normal @ transform_points(object_from_camera, point)
        disc = trimesh.creation.cylinder(PLANE_RADIUS, 0.002, sections=64)
        disc.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], normal))
        disc.apply_translation(normal * (height - 0.001))
        parts.append(painted(disc, OBSTACLE))
    return parts
