"""Thirty lines as a user writes them: `make lint` checks their types by mypy and pyright, strictly."""

# pyright: strict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import grasptransfer as gt


def reachable(world_from_gripper: NDArray[np.float64]) -> bool:
    return bool(world_from_gripper[2, 3] > 0.0)


def main(folder: Path) -> None:
    pose = gt.load_pose(folder / "pose.yaml")
    camera = gt.Camera.load(folder / "camera.yaml")
    category = gt.load_category("mug")
    flow = gt.GraspTransfer(category, gripper=gt.load_gripper("panda"), estimator="rigid", seed=1)
    result = flow.transfer(folder / "picture.png", pose, camera=camera, box=(284, 183, 404, 340))
    again = gt.transfer_grasps(
        np.zeros((480, 640, 3), np.uint8),
        pose,
        "mug",
        camera=camera,
        world_from_camera=np.eye(4),
        reachable=reachable,
    )
    for grasp in result.usable:
        matrix: NDArray[np.float64] = grasp.camera_from_gripper
        print(grasp.name, grasp.score, grasp.reason, matrix[:3, 3], reachable(matrix))
    moved: NDArray[np.float64] = result.field(np.zeros((4, 3)))
    trials = gt.simulate(result.usable[:1], result.mesh, result.gripper, protocol="lift-shake-v1", seed=0)
    held: list[bool] = [trial.held for trial in trials]
    both = gt.register_pair(result, again)
    segmented = flow.transfer(
        [folder / "a.png", folder / "b.png"], [pose, pose], mask=lambda rgb: rgb[..., 0] > 9
    )
    found = gt.find_pose(folder / "picture.png", "mug", camera=camera, box=[284, 183, 404, 340])
    print(segmented.status, [one.camera_from_object for one in found])
    print(moved, held, both, gt.list_categories(), gt.list_grippers(), gt.__version__)
    result.report(folder / "report.html")
    result.save(folder / "out")


if __name__ == "__main__":
    main(Path())
