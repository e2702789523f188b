"""Pictures of a recorded trial: the gripper, the object and the table, frame by frame."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from grasptransfer.camera import Camera
from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing
from grasptransfer.frames import rigid
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.simulation.outcome import Recording

if TYPE_CHECKING:
    import trimesh

GROUND = (244, 246, 249)
HAND, FINGERS, TABLE = (225, 228, 232), (88, 98, 112), (206, 198, 186)
SUPERSAMPLING = 2
FIELD_OF_VIEW = np.deg2rad(28)
MARGIN = 1.12


def draw_trial(
    recording: Recording,
    mesh: "trimesh.Trimesh | trimesh.Scene",
    gripper: Gripper,
    *,
    width: int = 400,
    height: int = 400,
    frames: Sequence[int] | None = None,
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """One picture of each recorded moment, all from the same place: across the closing direction.

    Args:
        mesh: the object as it shall look, object frame [m].
        gripper: the one that was recorded.
        width, height: pixels.
        frames: which moments to draw; None: all.
    """
    from grasptransfer.perception.rendering import Lighting, Renderer

    camera = Camera.from_fov(width * SUPERSAMPLING, height * SUPERSAMPLING, FIELD_OF_VIEW)
    parts = _links(gripper)
    camera_from_world = _viewpoint(recording, mesh, parts, gripper, camera)
    light = Lighting(0.3, np.array([[-0.5, -0.9, -0.5], [0.9, -0.1, -0.6]]),
                     np.array([[2.4, 2.35, 2.3], [0.8, 0.85, 0.95]]))  # fmt: skip
    backdrop = np.full((camera.height, camera.width, 3), GROUND, np.uint8)
    pictures = []
    with Renderer() as renderer:
        for i in range(len(recording.seconds)) if frames is None else frames:
            scene = _scene(recording, i, mesh, parts)
            picture = renderer.render(scene, camera, camera_from_world, lighting=light).over(backdrop)
            blocks = picture.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 3).mean((1, 3))
            pictures.append(np.round(blocks).astype(np.uint8))
    return pictures


def save_gif(
    pictures: Sequence[UInt8[np.ndarray, "h w 3"]], path: str | Path, *, frames_per_second: float = 20.0
) -> Path:
    """Write an endless GIF; its last picture stays for a second."""
    from PIL import Image

    if not pictures:
        raise SettingsError("there are no pictures to save", key="pictures", path=path)
    images = [Image.fromarray(picture) for picture in pictures]
    # One palette for all: colours that flicker from frame to frame look like motion.
    palette = images[len(images) // 2].quantize(192, dither=Image.Dither.NONE)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    duration = [round(1000 / frames_per_second)] * (len(images) - 1) + [1000]
    path = Path(path)
    with replacing(path) as temporary:
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=duration, loop=0)
    return path


def _links(gripper: Gripper) -> "dict[str, trimesh.Trimesh]":
    moving = {link.name for link in gripper.links if any(joint.kind != "fixed" for joint in link.chain)}
    return {
        link.name: _painted(link.visual, FINGERS if link.name in moving else HAND)
        for link in gripper.links
        if link.visual is not None
    }


def _painted(mesh: "trimesh.Trimesh", colour: tuple[int, int, int]) -> "trimesh.Trimesh":
    import trimesh

    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*colour, 255], metallicFactor=0.0, roughnessFactor=0.7
    )
    # Unmerged faces keep the creases of boxes and linkages sharp.
    faces = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    vertices, normals = mesh.triangles.reshape(-1, 3), np.repeat(mesh.face_normals, 3, axis=0)
    visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(vertices), 2)), material=material)
    return trimesh.Trimesh(vertices, faces, vertex_normals=normals, visual=visual, process=False)


def _scene(
    recording: Recording,
    index: int,
    mesh: "trimesh.Trimesh | trimesh.Scene",
    parts: "dict[str, trimesh.Trimesh]",
) -> "trimesh.Scene":
    import trimesh

    scene = trimesh.Scene()
    if recording.table_height is not None:
        table = trimesh.creation.cylinder(radius=0.2, height=0.01, sections=96)
        scene.add_geometry(
            _painted(table, TABLE),
            transform=rigid(np.eye(3), np.array([0, 0, recording.table_height - 0.006])),
        )
    for name, part in parts.items():
        scene.add_geometry(part, transform=recording.world_from_link[name][index])
    world_from_object = recording.world_from_object[index]
    for piece in mesh.dump() if isinstance(mesh, trimesh.Scene) else [mesh]:
        scene.add_geometry(piece, transform=world_from_object)
    return scene


def _viewpoint(
    recording: Recording,
    mesh: "trimesh.Trimesh | trimesh.Scene",
    parts: "dict[str, trimesh.Trimesh]",
    gripper: Gripper,
    camera: Camera,
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_world`: level with the motion, across the closing direction, all of it in view."""
    from grasptransfer.perception.views import look_at

    tcp = recording.world_from_link[gripper.base_link][-1] @ gripper.base_from_tcp
    across = tcp[:3, 1] if np.linalg.norm(tcp[:2, 1]) > 0.3 else tcp[:3, 2]
    azimuth = float(np.arctan2(across[1], across[0])) + np.deg2rad(25)
    if np.cos(azimuth) < -0.2:  # the category's front is +x: look at it rather than at the back
        azimuth += np.pi
    held = slice(0, len(recording.seconds), max(1, len(recording.seconds) // 20))
    bounds = [_corners(mesh.bounds, pose) for pose in recording.world_from_object[held]]
    for name, part in parts.items():
        bounds += [_corners(part.bounds, pose) for pose in recording.world_from_link[name][held]]
    corners = np.concatenate(bounds)
    # An object that was dropped falls for metres; the gripper is what to look at.
    base = recording.world_from_link[gripper.base_link][:, :3, 3]
    corners = corners[np.abs(corners - base.mean(0)).max(1) < 0.45]
    middle = (corners.min(0) + corners.max(0)) / 2
    pose = look_at(1.0, azimuth, np.deg2rad(18)) @ rigid(np.eye(3), -middle)
    x, y, z = (corners @ pose[:3, :3].T + pose[:3, 3]).T
    # As near as every corner allows: each one bounds the distance by its own angle.
    narrow = np.array([camera.width, camera.height]) / 2 / np.array([camera.fx, camera.fy]) / MARGIN
    nearest = np.maximum(np.abs(x) / narrow[0], np.abs(y) / narrow[1]) - z
    pose[2, 3] += float(nearest.max())
    return pose


def _corners(
    bounds: Float[np.ndarray, "2 3"], world_from_part: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "8 3"]:
    grid = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    return grid @ world_from_part[:3, :3].T + world_from_part[:3, 3]


def evenly(recording: Recording, count: int) -> list[int]:
    """Indices of `count` moments spread over a recording, the first and the last among them."""
    return sorted(set(np.linspace(0, len(recording.seconds) - 1, count).round().astype(int).tolist()))


def without_approach(recording: Recording) -> Recording:
    """The recording from the grasp on, for pictures that begin when the fingers close."""
    start = next((i for i, phase in enumerate(recording.phases) if phase != "approach"), 0)
    return dataclasses.replace(
        recording,
        seconds=recording.seconds[start:] - recording.seconds[start],
        phases=recording.phases[start:],
        world_from_object=recording.world_from_object[start:],
        world_from_link={name: poses[start:] for name, poses in recording.world_from_link.items()},
    )
