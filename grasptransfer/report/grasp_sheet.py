"""Grasps side by side in one picture, each with its name below: for people who look before they execute."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.report.grasp_pictures import PICTURE, DrawnGrasp, GraspPictures
from grasptransfer.report.studio import GROUND, Studio

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper, Scene

LINE, GAP = 26, 6  # px: height of a name, space between pictures
INK = (40, 44, 52)


def grasp_sheet(
    path: str | Path,
    mesh: trimesh.Trimesh,
    grasps: Sequence[DrawnGrasp],
    gripper: "Gripper",
    *,
    scene: "Scene | None" = None,
    camera_from_object: Float[np.ndarray, "4 4"] | None = None,
    columns: int = 4,
) -> Path:
    """Write a picture of every grasp on the object: fingers green where it is usable, red where not.

    Args:
        path: PNG or JPEG to write.
        mesh: the object, object frame [m].
        grasps: of a transfer, or `PlacedGrasp`s.
        gripper: drawn opened as it arrives.
        scene: what stands around the object, camera frame.
        camera_from_object: (4, 4) where the object was seen from [m]; None: no photograph.
        columns: pictures in a row.

    Raises:
        SettingsError: no grasps, an unknown kind of picture, or the file cannot be written.
    """
    path = Path(path)
    kinds = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
    if path.suffix.lower() not in kinds:
        raise SettingsError("names no kind of picture", path=path, value=path.suffix, choices=kinds)
    if not grasps:
        raise SettingsError("there is no grasp to draw", key="grasps", path=path)
    with Renderer() as renderer:
        drawn = GraspPictures(
            mesh, gripper, Studio(renderer), scene=scene, camera_from_object=camera_from_object
        )
        pictures = [drawn.draw(grasp) for grasp in grasps]
    sheet = _side_by_side(pictures, [grasp.name for grasp in grasps], min(columns, len(pictures)))
    buffer = io.BytesIO()
    sheet.save(buffer, kinds[path.suffix.lower()])
    write_whole(path, buffer.getvalue())
    return path


def _side_by_side(
    pictures: Sequence[UInt8[np.ndarray, "h w 3"]], names: Sequence[str], columns: int
) -> Image.Image:
    """Pictures in rows, each with its name below."""
    rows = -(-len(pictures) // columns)
    width, height = PICTURE
    size = (columns * (width + GAP) - GAP, rows * (height + LINE + GAP) - GAP)
    sheet = Image.new("RGB", size, GROUND)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for i, (name, picture) in enumerate(zip(names, pictures, strict=True)):
        left, top = i % columns * (width + GAP), i // columns * (height + LINE + GAP)
        sheet.paste(Image.fromarray(picture), (left, top))
        pen.text((left + 8, top + height + 3), name, INK, font)
    return sheet
