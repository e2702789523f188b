"""The picture of the demo: a test mug, which no training saw, on a table among other objects.

    python -m grasptransfer.workshop.demo_picture

writes it again into `objects/mug/demo`: `picture.png`, `camera.yaml`, `pose.yaml` (a little wrong, as from a
pose estimator) and `truth.yaml` (which mug it is, and where it really stands).
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import yaml
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFilter
from scipy.spatial.transform import Rotation
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.camera import Camera
from grasptransfer.category import load_category, objects_folder
from grasptransfer.drawing.lighting import Lighting
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.studio import smaller
from grasptransfer.drawing.views import look_at
from grasptransfer.files import write_whole
from grasptransfer.frames import rigid
from grasptransfer.workshop import objects

CATEGORY, INSTANCE = "mug", "mug_0020"
CAMERA = Camera(690.0, 690.0, 319.5, 239.5, 640, 480)
AZIMUTH, ELEVATION, DISTANCE = np.deg2rad(52.0), np.deg2rad(30.0), 0.50
POSE_ERROR_M, POSE_ERROR_DEGREES = (0.004, -0.003, 0.007), (1.5, -1.0, 2.0)
TABLE_SIDE, TABLE_PIXELS = 2.4, 2400  # m, px
TO_LIGHT = np.array([-0.45, 0.25, 1.0])  # from the table to the lamp, object frame
SUPERSAMPLING = 2


@dataclass(frozen=True)
class Clutter:
    """Something else on the table.

    Args:
        category, seed: category and seed of the parametric shape.
        place: position of its middle on the table: to the right of the mug, and behind it [m].
        degrees: turn about the vertical.
    """

    category: str
    seed: int
    place: tuple[float, float]
    degrees: float


CLUTTER = (
    Clutter("bottle", 2, (0.155, 0.13), 40),
    Clutter("spray_bottle", 3, (0.06, 0.42), 120),
    Clutter("camera", 5, (-0.17, 0.17), 50),
    Clutter("mug", 36, (-0.30, 0.50), 100),
)


def write_demo_picture(folder: Path | None = None) -> Path:
    """Render the demo's picture and write its folder.

    Args:
        folder: to write; the shipped one if None.
    """
    folder = Path(folder) if folder else objects_folder() / CATEGORY / "demo"
    pose = look_at(DISTANCE, AZIMUTH, ELEVATION)
    # The mug stands a little off the middle of the picture, as things do.
    pose[:3, 3] += [0.015, 0.02, 0.0]
    picture = render_table(pose)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", optimize=True)
    write_whole(folder / "picture.png", buffer.getvalue())
    write_whole(folder / "camera.yaml", _camera_text().encode())
    write_whole(folder / "pose.yaml", _pose_text(given_pose(pose)).encode())
    truth = f"# What the picture shows, to measure against.\ninstance: {INSTANCE}\n"
    write_whole(folder / "truth.yaml", (truth + _pose_text(pose)).encode())
    return folder


def given_pose(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The pose as an estimator of ordinary quality would predict it."""
    turn = Rotation.from_rotvec(np.deg2rad(POSE_ERROR_DEGREES)).as_matrix()
    return rigid(turn @ camera_from_object[:3, :3], camera_from_object[:3, 3] + POSE_ERROR_M)


def render_table(camera_from_object: Float[np.ndarray, "4 4"]) -> UInt8[np.ndarray, "480 640 3"]:
    """The mug, the clutter, the table and the wall, with soft shadows, as a cheap camera sees them."""
    mug = load_category(CATEGORY).instance_scene(INSTANCE)
    height = float(mug.bounds[0, 2])
    others = [_placed(thing, height) for thing in CLUTTER]
    things = [_one_mesh(scene) for scene in (mug, *others)]
    room = [_wall(height), _table(things, height)]
    opaque_first = trimesh.Scene()
    for part in [*room, *(part for scene in others for part in scene.dump()), *mug.dump()]:
        opaque_first.add_geometry(part)
    camera = CAMERA.crop((-0.5, -0.5, CAMERA.width - 0.5, CAMERA.height - 0.5),
                         CAMERA.width * SUPERSAMPLING, CAMERA.height * SUPERSAMPLING)  # fmt: skip
    to_light = camera_from_object[:3, :3] @ TO_LIGHT
    lighting = Lighting(
        0.42, np.stack([to_light, [0.6, -0.5, -0.7]]), np.array([[2.5, 2.4, 2.2], [0.5, 0.55, 0.65]])
    )
    with Renderer() as renderer:
        drawn = renderer.render(opaque_first, camera, camera_from_object, lighting=lighting)
    return _as_photographed(smaller(drawn.rgb, SUPERSAMPLING))


def _one_mesh(scene: trimesh.Scene) -> trimesh.Trimesh:
    mesh = scene.to_geometry()
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def _placed(thing: Clutter, height: float) -> trimesh.Scene:
    """The clutter standing on the table."""
    scene = objects.sample(thing.category, thing.seed).scene()
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH)])
    behind = -np.array([np.cos(AZIMUTH), np.sin(AZIMUTH)])
    spot = thing.place[0] * right + thing.place[1] * behind
    turn = Rotation.from_euler("z", thing.degrees, degrees=True).as_matrix()
    place = rigid(turn, np.array([*spot, height - scene.bounds[0, 2]]))
    scene.apply_transform(place)
    return scene


def _table(things: Sequence[trimesh.Trimesh], height: float) -> trimesh.Trimesh:
    """A wooden table top with the shadows of the things painted on."""
    rng = np.random.default_rng(4)
    picture = _wood(rng).astype(float) * _shadow(things, height)[..., None]
    texture = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    half = TABLE_SIDE / 2
    corners = np.array(
        [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    )
    return _textured(corners, texture, roughness=0.6)


def _wall(height: float) -> trimesh.Trimesh:
    """A plain wall behind the table, lighter towards the lamp."""
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:256, 0:512] / 256
    picture = np.array([176.0, 182, 180]) * (1.05 - 0.12 * u + 0.06 * v)[..., None] + rng.normal(
        0, 1.5, (256, 512, 1)
    )
    away = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0]) * -0.95
    side = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0]) * 2.0
    low, high = np.array([0, 0, height - 0.5]), np.array([0, 0, height + 1.5])
    corners = np.stack([away - side + low, away + side + low, away + side + high, away - side + high])
    return _textured(corners, Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8)), roughness=0.9)


def _textured(
    corners: Float[np.ndarray, "4 3"], texture: Image.Image, *, roughness: float
) -> trimesh.Trimesh:
    material = PBRMaterial(baseColorTexture=texture, metallicFactor=0.0, roughnessFactor=roughness)
    visual = TextureVisuals(uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float), material=material)
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def _wood(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Boards side by side, each with its own tone and grain."""
    boards = 16
    wide = TABLE_PIXELS // boards
    rows = []
    for _ in range(boards):
        grain = np.zeros((wide, TABLE_PIXELS))
        for octave, strength in ((3, 1.0), (5, 0.6), (8, 0.4)):
            coarse = rng.normal(size=(2**octave // 2, 2 + 2**octave // 4)).astype(np.float32)
            grain += strength * np.asarray(
                Image.fromarray(coarse).resize((TABLE_PIXELS, wide), Image.Resampling.BICUBIC)
            )
        lines = 0.5 + 0.5 * np.sin(2 * np.pi * (np.arange(wide)[:, None] / 21 + 0.9 * grain))
        board = (
            np.array([166.0, 118, 74])
            * rng.uniform(0.9, 1.08)
            * (0.88 + 0.14 * lines + 0.03 * grain)[..., None]
        )
        board[:2] *= 0.55
        rows.append(board + rng.normal(0, 3, (wide, TABLE_PIXELS, 1)))
    return np.clip(np.concatenate(rows), 0, 255).astype(np.uint8)


def _shadow(things: Sequence[trimesh.Trimesh], height: float) -> Float[np.ndarray, "h w"]:
    """How much light reaches each point of the table: cast by the lamp, and darker close under the things."""
    cast, under = (Image.new("L", (TABLE_PIXELS, TABLE_PIXELS), 0) for _ in range(2))
    for mesh in things:
        above = mesh.vertices[:, 2] - height
        along = mesh.vertices[:, :2] - above[:, None] * TO_LIGHT[:2] / TO_LIGHT[2]
        low = above < 0.012
        _fill(cast, along[mesh.faces])
        _fill(under, mesh.vertices[:, :2][mesh.faces[low[mesh.faces].all(1)]])
    pixels_per_m = TABLE_PIXELS / TABLE_SIDE
    cast = cast.filter(ImageFilter.GaussianBlur(0.012 * pixels_per_m))
    under = under.filter(ImageFilter.GaussianBlur(0.010 * pixels_per_m))
    return (1 - 0.52 * np.asarray(cast) / 255) * (1 - 0.45 * np.asarray(under) / 255)


def _fill(image: Image.Image, triangles: Float[np.ndarray, "f 3 2"]):
    draw = ImageDraw.Draw(image)
    pixels = (triangles / TABLE_SIDE + 0.5) * TABLE_PIXELS
    pixels[..., 1] = TABLE_PIXELS - pixels[..., 1]  # The v axis of a texture points up.
    for triangle in pixels:
        draw.polygon([tuple(corner) for corner in triangle], fill=255)


def _as_photographed(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """A lens a little soft and darker to the corners, and a sensor with noise."""
    rng = np.random.default_rng(6)
    soft = np.asarray(Image.fromarray(picture).filter(ImageFilter.GaussianBlur(0.6)), float)
    v, u = np.mgrid[-1 : 1 : soft.shape[0] * 1j, -1 : 1 : soft.shape[1] * 1j]
    soft *= (1 - 0.10 * (u**2 + v**2))[..., None]
    soft += rng.normal(0, 2.2, soft.shape)
    return np.clip(np.round(soft), 0, 255).astype(np.uint8)


def _camera_text() -> str:
    names = ("fx", "fy", "cx", "cy", "width", "height")
    return "# Pixels; (0, 0) is the centre of the top-left one.\n" + yaml.safe_dump(
        {name: getattr(CAMERA, name) for name in names}, sort_keys=False
    )


def _pose_text(camera_from_object: Float[np.ndarray, "4 4"]) -> str:
    rows = [[round(float(value), 6) for value in line] for line in camera_from_object]
    text = yaml.safe_dump({"camera_from_object": rows}, default_flow_style=None)
    return "# OpenCV axes, metres.\n" + text


if __name__ == "__main__":
    write_demo_picture()
