"""Offscreen pictures of meshes by pyrender: RGB, coverage, depth and positions.

pyrender is OpenGL (the camera looks along -z) and counts pixels from their corners;
everything else here is OpenCV with pixel centres at whole numbers. Both are converted
in `_Stage.aim`, and nowhere else.
"""

import ctypes.util
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.lighting import Lighting, pose_shining_from
from grasptransfer.errors import GraspTransferError, PoseError
from grasptransfer.frames import OPENGL_FROM_OPENCV, invert, transform_points

if sys.platform == "linux":
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")  # read once, when OpenGL is imported


@dataclass(frozen=True)
class Rendering:
    """One picture of an object.

    Args:
        rgb: (h, w, 3) the object over black.
        alpha: (h, w) coverage in [0, 1]; between them where the object lets light through.
        depth: (h, w) metres along the optical axis, 0 where there is no object.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    alpha: Float32[np.ndarray, "h w"]
    depth: Float32[np.ndarray, "h w"]

    @property
    def mask(self) -> Bool[np.ndarray, "h w"]:
        """(h, w) where the object is."""
        return self.depth > 0

    def over(self, background: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """The object in front of `background`."""
        mixed = self.rgb + background * (1 - self.alpha[..., None])
        return np.clip(np.round(mixed), 0, 255).astype(np.uint8)


def position_image(
    depth: Float32[np.ndarray, "h w"], camera: Camera, camera_from_object: Float[np.ndarray, "4 4"]
) -> Float32[np.ndarray, "h w 3"]:
    """Object-frame position [m] of each pixel's surface point; NaN where depth is 0."""
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    points_camera = camera.unproject(np.stack([u, v], -1).astype(float), depth.astype(float))
    positions = transform_points(invert(camera_from_object), points_camera)
    positions[depth <= 0] = np.nan
    return positions.astype(np.float32)


def _keep_display(platform: Any) -> None:
    """Let a closing renderer destroy its own context only: all of a process share one EGL display."""
    if not hasattr(platform, "_egl_context"):
        return

    def delete_context() -> None:
        from OpenGL.EGL import eglDestroyContext

        if platform._egl_context is not None:
            eglDestroyContext(platform._egl_display, platform._egl_context)
            platform._egl_context = None

    platform.delete_context = delete_context


class Renderer:
    """Keeps one OpenGL context, and the meshes seen last ready to draw; use as a context manager.

    Raises:
        GraspTransferError: this machine cannot draw: a library or a device of EGL is missing.
    """

    def __init__(self):
        pyrender = _pyrender()
        from OpenGL.error import Error

        try:
            self._context = pyrender.OffscreenRenderer(64, 64)
        except (ValueError, Error) as error:  # ValueError: there is no device of that number
            raise GraspTransferError(
                "cannot draw here: EGL, which renders without a display, finds no device",
                key="EGL",
                value=str(error),
                fix="sudo apt-get install libegl1 libgl1 libgl1-mesa-dri, which draw on the CPU",
            ) from error
        _keep_display(self._context._platform)
        self._stages: dict[int, tuple[object, _Stage]] = {}

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Free the OpenGL context."""
        self._context.delete()

    def depth(
        self,
        mesh: trimesh.Trimesh | trimesh.Scene,
        camera: Camera,
        camera_from_object: Float[np.ndarray, "4 4"],
    ) -> Float32[np.ndarray, "h w"]:
        """Depth [m] of `mesh`, 0 where there is none: much quicker than a full picture."""
        stage = self._stage(mesh)
        stage.aim(camera, camera_from_object)
        self._resize(camera)
        return self._draw_depth(stage)

    def render(
        self,
        mesh: trimesh.Trimesh | trimesh.Scene,
        camera: Camera,
        camera_from_object: Float[np.ndarray, "4 4"],
        *,
        lighting: Lighting | None = None,
    ) -> Rendering:
        """Picture of `mesh` (object frame, metres) seen by `camera`.

        Edges are antialiased: `alpha` is the share of each pixel that is covered. A mesh with
        see-through parts is drawn over black and over white; the difference is its coverage.
        """
        stage = self._stage(mesh)
        stage.light(lighting or Lighting())
        stage.aim(camera, camera_from_object)
        self._resize(camera)
        rgba = self._draw_colour(stage, [0.0, 0.0, 0.0, 0.0])
        alpha = rgba[..., 3].astype(np.float32) / 255
        if stage.transparent:
            # Blending writes alpha squared into the alpha channel, so it cannot be read there.
            over_white = self._draw_colour(stage, [1.0, 1.0, 1.0, 1.0])
            clear = (over_white[..., :3].astype(np.float32) - rgba[..., :3]).mean(-1) / 255
            alpha = np.clip(1 - clear, 0, 1)
        return Rendering(rgba[..., :3], alpha, self._draw_depth(stage))

    def animate(
        self,
        parts: Sequence[trimesh.Trimesh],
        camera: Camera,
        camera_from_world: Float[np.ndarray, "4 4"],
        world_from_parts: Float[np.ndarray, "t p 4 4"],
        *,
        ground: tuple[int, int, int] = (255, 255, 255),
        lighting: Lighting | None = None,
    ) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """Pictures of opaque parts that move, over a plain ground, one at each of t moments."""
        stage = _Stage(trimesh.Scene(list(parts)))
        for node in list(stage.scene.mesh_nodes):
            stage.scene.remove_node(node)  # all parts in one; here each moves by itself
        drawable = [_pyrender().Mesh.from_trimesh(part, smooth=_is_smooth(part)) for part in parts]
        nodes = [stage.scene.add(part) for part in drawable]
        stage.radius += float(np.linalg.norm(world_from_parts[..., :3, 3], axis=-1).max())
        stage.light(lighting or Lighting())
        stage.aim(camera, camera_from_world)
        self._resize(camera)
        colour = [channel / 255 for channel in ground]
        for world_from_part in world_from_parts:
            for node, pose in zip(nodes, world_from_part, strict=True):
                stage.scene.set_pose(node, pose)
            yield self._draw_colour(stage, [*colour, 1.0])[..., :3]

    def _draw_colour(self, stage: "_Stage", background: list[float]) -> UInt8[np.ndarray, "h w 4"]:
        stage.scene.bg_color = np.array(background)
        picture = self._context.render(stage.scene, flags=_pyrender().RenderFlags.RGBA)
        assert picture is not None
        return picture[0]

    def _draw_depth(self, stage: "_Stage") -> Float32[np.ndarray, "h w"]:
        # Segmentation is pyrender's only pass without multisampling, whose depth would belong
        # to a point up to 0.4 px beside the pixel's centre.
        nodes = {node: 255 for node in stage.scene.mesh_nodes}
        picture = self._context.render(stage.scene, flags=_pyrender().RenderFlags.SEG, seg_node_map=nodes)
        assert picture is not None
        return picture[1]

    def _resize(self, camera: Camera):
        self._context.viewport_width, self._context.viewport_height = camera.width, camera.height

    def _stage(self, mesh: trimesh.Trimesh | trimesh.Scene) -> "_Stage":
        # The mesh itself is kept beside its stage: an id is unique only while its object lives.
        known = self._stages.get(id(mesh))
        if known is None:
            while len(self._stages) >= 8:
                self._stages.pop(next(iter(self._stages)))
            known = self._stages[id(mesh)] = (mesh, _Stage(mesh))
        return known[1]


class _Stage:
    """A pyrender scene with one object, a camera and lights."""

    def __init__(self, mesh: trimesh.Trimesh | trimesh.Scene):
        pyrender = _pyrender()
        self.scene = pyrender.Scene(bg_color=[0, 0, 0, 1.0], ambient_light=[0.3] * 3)
        parts = _parts(mesh)
        self.radius = max(float(np.linalg.norm(part.vertices, axis=1).max()) for part in parts)
        primitives = []
        for part in parts:
            clear = _is_clear(part)
            for primitive in pyrender.Mesh.from_trimesh(part, smooth=_is_smooth(part)).primitives:
                # pyrender looks at factors only and takes a texture with alpha for opaque.
                primitive.material.alphaMode = "BLEND" if clear else "OPAQUE"
                # The order of a see-through part's own triangles would show, were both sides drawn.
                primitive.material.doubleSided = not clear
                primitives.append(primitive)
        self.transparent = any(_is_clear(part) for part in parts)
        # One node, so that its parts are drawn in their order: what is behind glass comes first.
        # Several nodes would be drawn in the order of a set, another one each time.
        self.scene.add(pyrender.Mesh(primitives))
        self.camera_node = None
        self.light_nodes: list = []

    def aim(self, camera: Camera, camera_from_object: Float[np.ndarray, "4 4"]):
        pyrender = _pyrender()
        distance = camera_from_object[2, 3]
        if distance <= 0:
            raise PoseError("the object lies behind the camera", key="pose", value=f"z = {distance:.3f} m")
        lens = pyrender.IntrinsicsCamera(
            camera.fx,
            camera.fy,
            camera.cx + 0.5,
            camera.cy + 0.5,
            znear=max(distance - 1.1 * self.radius, 0.01),
            zfar=distance + 1.1 * self.radius,
        )
        pose = invert(camera_from_object) @ OPENGL_FROM_OPENCV
        if self.camera_node is not None:
            self.scene.remove_node(self.camera_node)
        self.camera_node = self.scene.add(lens, pose=pose)
        for node, camera_from_light in self.light_nodes:
            self.scene.set_pose(node, invert(camera_from_object) @ camera_from_light)

    def light(self, lighting: Lighting):
        pyrender = _pyrender()
        for node, _ in self.light_nodes:
            self.scene.remove_node(node)
        self.scene.ambient_light = np.full(3, lighting.ambient)
        self.light_nodes = []
        for direction, colour in zip(lighting.directions_camera, lighting.colours, strict=True):
            intensity = float(np.max(colour))
            light = pyrender.DirectionalLight(color=colour / max(intensity, 1e-9), intensity=intensity)
            self.light_nodes.append((self.scene.add(light), pose_shining_from(direction)))


def _parts(mesh: trimesh.Trimesh | trimesh.Scene) -> list[trimesh.Trimesh]:
    """The parts in their frame's place, in order; copies keep the normals they came with."""
    if isinstance(mesh, trimesh.Trimesh):
        return [mesh]
    parts = []
    for node in mesh.graph.nodes_geometry:
        place, name = mesh.graph[node]
        part = mesh.geometry[name]
        if not np.array_equal(place, np.eye(4)):
            part = part.copy(include_cache=True).apply_transform(place)
        parts.append(part)
    return parts


def _is_clear(part: trimesh.Trimesh) -> bool:
    material = getattr(part.visual, "material", None)
    return getattr(material, "alphaMode", None) == "BLEND"


def _is_smooth(mesh: trimesh.Trimesh) -> bool:
    # Scans and textured meshes bring their normals; a coarse untextured one looks better faceted.
    return getattr(mesh.visual, "kind", None) == "texture" or len(mesh.faces) > 2000


@lru_cache(maxsize=1)
def _pyrender():
    for library, package in (("EGL", "libegl1"), ("GL", "libgl1")):
        if os.environ.get("PYOPENGL_PLATFORM") == "egl" and ctypes.util.find_library(library) is None:
            raise GraspTransferError(
                f"the system library {library}, needed to render without a display, is missing",
                fix=f"sudo apt-get install {package} libgl1-mesa-dri",
            )
    import pyrender

    return pyrender
