"""The reconstruction with grippers at its best grasps: as one GLB file, and as a page to turn by hand."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from grasptransfer.drawing.studio import painted, together
from grasptransfer.frames import invert
from grasptransfer.report.grasp_pictures import OBJECT, USABLE, painted_gripper, surroundings

if TYPE_CHECKING:
    from grasptransfer.result import TransferredGrasp, TransferResult

SHOWN = 3  # grasps; more hide each other
# The viewer looks at a scene whose y axis points up, as glTF has it.
VIEWER_FROM_OBJECT = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])


def best_of_each_label(grasps: "Sequence[TransferredGrasp]") -> "list[TransferredGrasp]":
    """The first grasp of each label, in order: one at the rim, one at the handle, ..."""
    best: dict[str, TransferredGrasp] = {}
    for grasp in grasps:
        best.setdefault(grasp.label, grasp)
    return list(best.values())


def shown_grasps(result: "TransferResult") -> "list[TransferredGrasp]":
    """The best usable grasp of each label, at most `SHOWN`."""
    return best_of_each_label(result.usable)[:SHOWN]


def drawn_grippers(result: "TransferResult") -> list[trimesh.Trimesh]:
    """The opened gripper at the best grasp, and its fingers alone at the others of `shown_grasps`.

    Whole hands at grasps a finger's breadth apart would hide each other, and the object.
    """
    parts = []
    for grasp in shown_grasps(result):
        gripper = painted_gripper(result.gripper, grasp.opening, grasp.object_from_gripper, USABLE)
        parts += gripper.fingers if parts else gripper.parts
    return parts


def grasp_scene(result: "TransferResult") -> trimesh.Scene:
    """The reconstruction, its surroundings and `drawn_grippers`, object frame [m]."""
    object_from_camera = invert(result.camera_from_object)
    around = surroundings(result.scene, object_from_camera)
    return together([painted(result.mesh, OBJECT), *around, *drawn_grippers(result)])


def scene_glb(result: "TransferResult") -> bytes:
    """`grasp_scene` as GLB, vertices in the object frame [m]."""
    content = grasp_scene(result).export(file_type="glb", include_normals=True)
    assert isinstance(content, bytes)
    return content


def scene_page(result: "TransferResult") -> str:
    """`grasp_scene` as an HTML page that asks for nothing from outside."""
    from trimesh.viewer.notebook import scene_to_html

    scene = grasp_scene(result)
    scene.apply_transform(VIEWER_FROM_OBJECT)
    return scene_to_html(scene)
