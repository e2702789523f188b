"""A small photo studio: meshes in plain colours on a light ground, seen from chosen sides."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import Box, projected_box, union
from grasptransfer.drawing.lighting import Lighting
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import invert, transform_points

Colour = tuple[int, int, int]

GROUND: Colour = (246, 247, 249)
CANONICAL: Colour = (214, 142, 54)
RECONSTRUCTION: Colour = (28, 120, 150)
SUPERSAMPLING = 2  # thin fingers and outlines need more than the graphics library's antialiasing
CREASE = np.deg2rad(40)  # sharper edges stay sharp
LIGHTING = Lighting(
    0.28,
    np.array([[-0.6, -0.9, -0.5], [0.9, 0.0, -0.5], [0.1, -0.5, 0.9]]),
    np.array([[2.3, 2.25, 2.2], [0.6, 0.65, 0.75], [0.6, 0.6, 0.65]]),
)


@dataclass(frozen=True)
class View:
    """A camera and where it stands.

    Args:
        camera: intrinsics of the picture.
        camera_from_object: (4, 4) [m].
    """

    camera: Camera
    camera_from_object: Float[np.ndarray, "4 4"]

    def pixels(self, points_object: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*m 2"]:
        """Pixels (u, v) of points in the object frame [m]."""
        return self.camera.project(transform_points(self.camera_from_object, points_object))

    def finer(self, factor: int) -> "View":
        """The same view with `factor` times as many pixels along each side."""
        camera = self.camera
        box = (-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
        return View(camera.crop(box, camera.width * factor, camera.height * factor), self.camera_from_object)


def painted(mesh: trimesh.Trimesh, colour: Colour, *, opacity: float = 1.0) -> trimesh.Trimesh:
    """The geometry in one matt colour, smooth but for its creases."""
    plain = trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=False)
    plain.merge_vertices(merge_tex=True, merge_norm=True)  # seams of the texture are no creases
    plain = trimesh.graph.smooth_shade(plain, angle=CREASE)
    material = PBRMaterial(
        baseColorFactor=[*colour, round(255 * opacity)],
        metallicFactor=0.0,
        roughnessFactor=0.75,
        alphaMode="OPAQUE" if opacity == 1 else "BLEND",
    )
    normals = plain.vertex_normals
    plain.visual = TextureVisuals(uv=np.zeros((len(plain.vertices), 2)), material=material)
    return trimesh.Trimesh(
        plain.vertices, plain.faces, vertex_normals=normals, visual=plain.visual, process=False
    )


def together(parts: list[trimesh.Trimesh]) -> trimesh.Scene:
    """Parts in one scene, see-through ones last."""
    scene = trimesh.Scene()
    for part in sorted(parts, key=_see_through):
        scene.add_geometry(part)
    return scene


def _see_through(part: trimesh.Trimesh) -> bool:
    material = getattr(part.visual, "material", None)
    return getattr(material, "alphaMode", None) == "BLEND"


class Studio:
    """Draws with one warm renderer."""

    def __init__(self, renderer: Renderer):
        self.renderer = renderer

    def draw(
        self, subject: trimesh.Trimesh | trimesh.Scene, view: View, *, ground: Colour = GROUND
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The subject on the light ground."""
        fine = view.finer(SUPERSAMPLING)
        picture = self.renderer.render(subject, fine.camera, fine.camera_from_object, lighting=LIGHTING)
        backdrop = np.broadcast_to(np.array(ground, np.uint8), picture.rgb.shape)
        return smaller(picture.over(backdrop), SUPERSAMPLING)

    def mask(self, subject: trimesh.Trimesh | trimesh.Scene, view: View) -> Bool[np.ndarray, "h w"]:
        """Pixels that the subject covers."""
        return self.renderer.depth(subject, view.camera, view.camera_from_object) > 0


def smaller(picture: UInt8[np.ndarray, "hs ws 3"], factor: int) -> UInt8[np.ndarray, "h w 3"]:
    """The mean of each block of `factor` x `factor` pixels."""
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    blocks = picture.reshape(height, factor, width, factor, 3).mean((1, 3))
    return np.clip(np.round(blocks), 0, 255).astype(np.uint8)


def observed_view(
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
    meshes: list[trimesh.Trimesh],
    *,
    width: int,
    height: int,
    margin: float = 1.25,
) -> View:
    """The photograph's own camera, zoomed to the meshes."""
    box = _box_around(camera, camera_from_object, meshes)
    return View(camera.crop(framed(box, width / height, margin), width, height), camera_from_object)


def hidden_view(
    camera_from_object: Float[np.ndarray, "4 4"],
    meshes: list[trimesh.Trimesh],
    *,
    width: int,
    height: int,
    turn: float = np.pi,
) -> View:
    """The side that the photograph does not show: the camera carried round the upright object.

    Args:
        turn: angle of the camera about the scene [rad].
    """
    to_camera = invert(camera_from_object)[:3, 3]
    azimuth = np.arctan2(to_camera[1], to_camera[0]) + turn
    elevation = np.arctan2(to_camera[2], np.linalg.norm(to_camera[:2]))
    return fitted_view(meshes, azimuth, float(np.clip(elevation, 0.25, 0.7)), width=width, height=height)


def fitted_view(
    meshes: list[trimesh.Trimesh],
    azimuth: float,
    elevation: float,
    *,
    width: int,
    height: int,
    margin: float = 1.2,
) -> View:
    """A view from a direction [rad], zoomed so that the meshes fill the picture."""
    radius = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
    pose = look_at(6 * radius, azimuth, elevation)
    camera = Camera.from_fov(width, height, 0.5)
    box = _box_around(camera, pose, meshes)
    return View(camera.crop(framed(box, width / height, margin), width, height), pose)


def _box_around(camera: Camera, pose: Float[np.ndarray, "4 4"], meshes: list[trimesh.Trimesh]) -> Box:
    boxes = [projected_box(np.asarray(mesh.vertices), camera, pose) for mesh in meshes]
    box = boxes[0]
    for other in boxes[1:]:
        box = union(box, other)
    return box


def framed(box: Box, aspect: float, margin: float) -> Box:
    """The box of this aspect ratio around `box`, enlarged by `margin`."""
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    width = max(box[2] - box[0], (box[3] - box[1]) * aspect, 8.0) * margin
    return u - width / 2, v - width / aspect / 2, u + width / 2, v + width / aspect / 2


def crop_photo(
    image: UInt8[np.ndarray, "h w 3"], camera: Camera, zoomed: Camera
) -> UInt8[np.ndarray, "hz wz 3"]:
    """The part of a photograph that the zoomed camera sees; black beyond its border."""
    scale_u, scale_v = camera.fx / zoomed.fx, camera.fy / zoomed.fy
    left = camera.cx + 0.5 - (zoomed.cx + 0.5) * scale_u
    top = camera.cy + 0.5 - (zoomed.cy + 0.5) * scale_v
    # The affine map of PIL takes corners of output pixels to corners of input pixels.
    matrix = (scale_u, 0, left, 0, scale_v, top)
    size = (zoomed.width, zoomed.height)
    source = Image.fromarray(image)
    if scale_u > 1:  # the map itself does not average what it skips
        shrink = int(np.ceil(scale_u))
        source = source.reduce(shrink)
        matrix = tuple(value / shrink for value in matrix)
    return np.asarray(source.transform(size, Image.Transform.AFFINE, matrix, Image.Resampling.BICUBIC))
