"""Plan grasps among obstacles: the same picture on an empty table, and with things beside the mug.

A scene holds a support plane and meshes, each with its pose in the camera frame; on the command line it is a
YAML file (`transfer --scene`). Every grasp that fails says which link meets which obstacle, and how deep.
Writes `cluttered.png`: look at it.

Usage: python examples/05_cluttered_table.py
"""

import numpy as np
import trimesh

import grasptransfer as gt
from grasptransfer.category import objects_folder
from grasptransfer.frames import rigid
from grasptransfer.report.grasp_sheet import grasp_sheet

DEMO = objects_folder() / "mug" / "demo"


def clutter(camera_from_object: np.ndarray, bottom: float) -> gt.Scene:
    """A table below the mug, a box beside it and a shelf above it, placed in the object's frame."""

    def standing(x: float, y: float, z: float) -> np.ndarray:
        return camera_from_object @ rigid(np.eye(3), np.array([x, y, z]))

    up = camera_from_object[:3, :3] @ [0.0, 0.0, 1.0]
    return gt.Scene(
        obstacles=(
            ("cereal box", trimesh.creation.box((0.06, 0.19, 0.26)), standing(-0.09, 0.0, bottom + 0.13)),
            ("shelf", trimesh.creation.box((0.10, 0.30, 0.015)), standing(0.09, 0.0, bottom + 0.16)),
        ),
        support_plane=(standing(0.0, 0.0, bottom)[:3, 3], up),
    )


def main():
    camera, pose = gt.Camera.load(DEMO / "camera.yaml"), gt.load_pose(DEMO / "pose.yaml")
    flow = gt.GraspTransfer("mug")
    empty = flow.transfer(DEMO / "picture.png", pose, camera=camera)
    # The refined pose and the reconstruction say where the table is.
    scene = clutter(empty.camera_from_object, float(empty.mesh.bounds[0, 2]))
    result = flow.transfer(DEMO / "picture.png", pose, camera=camera, scene=scene)
    print(f"usable: {len(empty.usable)} of {len(empty.grasps)} on the empty table, "
          f"{len(result.usable)} among the obstacles")  # fmt: skip
    for grasp in result.grasps:
        print(f"  {grasp.name:22s} {grasp.status.value:16s} {grasp.reason}")
        if not grasp.usable:
            print(f"  {'':22s} -> {grasp.status.advice}")
    sheet = grasp_sheet(
        "cluttered.png", result.mesh, result.grasps, result.gripper,
        scene=scene, camera_from_object=result.camera_from_object,
    )  # fmt: skip
    print(f"Look at {sheet}")


if __name__ == "__main__":
    main()
