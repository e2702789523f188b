"""Grasps side by side in one picture, each with its name below: for people who look before they execute."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.sheet import KINDS, encoded, sheet
from grasptransfer.drawing.studio import GROUND, Studio
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.report.grasp_pictures import DrawnGrasp, GraspPictures

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper, Scene


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
        grasps: of a transfer, or `GraspToDraw`s.
        gripper: drawn opened as it arrives.
        scene: what stands around the object, camera frame.
        camera_from_object: (4, 4) where the object was seen from [m]; None: no photograph.
        columns: pictures in a row.

    Raises:
        SettingsError: no grasps, an unknown kind of picture, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in KINDS:
        raise SettingsError("names no kind of picture", path=path, value=path.suffix, choices=KINDS)
    if not grasps:
        raise SettingsError("there is no grasp to draw", key="grasps", path=path)
    with Renderer() as renderer:
        drawn = GraspPictures(
            mesh, gripper, Studio(renderer), scene=scene, camera_from_object=camera_from_object
        )
        pictures = [drawn.draw(grasp) for grasp in grasps]
    page = sheet(pictures, min(columns, len(pictures)), captions=[g.name for g in grasps], ground=GROUND)
    write_whole(path, encoded(page, path.suffix))
    return path
