"""Transfer grasps from one RGB picture, and execute the best ones in PyBullet.

The picture shows a mug that no training saw, at a pose that is a little wrong. The robot goes to where it
believes the grasps are; the true mug stands where it really is. Writes `transfer.html`: look at it.

Usage: python examples/01_transfer_and_execute.py [--quick]
"""

import sys

import grasptransfer as gt
from grasptransfer.category import objects_folder
from grasptransfer.report.transfer_files import execute_best

DEMO = objects_folder() / "mug" / "demo"


def main():
    camera, pose = gt.Camera.load(DEMO / "camera.yaml"), gt.load_pose(DEMO / "pose.yaml")
    result = gt.transfer_grasps(DEMO / "picture.png", pose, "mug", camera=camera)
    print(f"{len(result.usable)} of {len(result.grasps)} grasps are usable, the best first:")
    for grasp in result.grasps:
        print(f"  {grasp.name:22s} score {grasp.score:.2f}  {grasp.reason}")

    # Only the simulator knows the true mesh and the true pose.
    mesh = result.category.instance_mesh("mug_0020")
    most = 1 if "--quick" in sys.argv else 3
    trials = execute_best(result, mesh, gt.load_pose(DEMO / "truth.yaml"), most=most)
    for trial in trials:
        print(f"{trial.grasp}: {trial.status.value} after {trial.phase}, slipped {trial.slip_mm:.1f} mm")
    print(f"Look at {result.report('transfer.html', trials=trials)}")


if __name__ == "__main__":
    main()
