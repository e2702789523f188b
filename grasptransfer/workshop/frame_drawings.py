"""Drawings of the frames for the documentation: `python -m grasptransfer.workshop.frame_drawings`."""

from pathlib import Path

import numpy as np
import tyro
from PIL import Image, ImageDraw, ImageFont

from grasptransfer.camera import Camera
from grasptransfer.category import Category, list_categories, load_category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.grasping import load_gripper
from grasptransfer.grasping.frames_table import draw_frames

FOLDER = Path("docs/pictures")
SIZE = (480, 360)  # px
COLOURS = {"x": (214, 48, 49), "y": (39, 148, 68), "z": (32, 96, 204)}
VIEW = (np.deg2rad(35), np.deg2rad(28))  # azimuth and elevation: the front, a side and the top are seen


def draw_category(category: Category, renderer: Renderer) -> Image.Image:
    """The canonical model on white, with the axes of its frame."""
    extents = np.asarray(category.canonical.extents)
    camera = Camera.from_fov(*SIZE, np.deg2rad(40))
    camera_from_object = look_at(2.9 * float(np.linalg.norm(extents)), *VIEW)
    seen = renderer.render(category.canonical, camera, camera_from_object)
    picture = Image.fromarray(seen.over(np.full((*SIZE[::-1], 3), 255, np.uint8)))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(22)
    for axis, (name, colour) in enumerate(COLOURS.items()):
        tip = np.zeros(3)
        tip[axis] = extents[axis] / 2 + 0.3 * extents.max()
        ends = np.stack([np.zeros(3), tip]) @ camera_from_object[:3, :3].T + camera_from_object[:3, 3]
        (u0, v0), (u1, v1) = camera.project(ends)
        draw.line((u0, v0, u1, v1), fill=colour, width=4)
        draw.ellipse((u1 - 5, v1 - 5, u1 + 5, v1 + 5), fill=colour)
        draw.text((u1 + 8, v1 - 24), name, fill=colour, font=font)
    return picture


def main(folder: Path = FOLDER) -> None:
    """Draw the frame of every category, and that of the Panda's hand.

    Args:
        folder: of the drawings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with Renderer() as renderer:
        for name in list_categories():
            draw_category(load_category(name), renderer).save(folder / f"frame_{name}.png", optimize=True)
    draw_frames(load_gripper("panda"), folder / "frame_panda.png")


if __name__ == "__main__":
    tyro.cli(main)
