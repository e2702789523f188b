"""Transfer grasps from one RGB picture, and execute the best one in PyBullet.

The picture shows a mug that no training saw. Its true mesh is used only by the simulator.

Usage: python examples/01_transfer_and_execute.py
"""

import yaml

import grasptransfer as gt
from grasptransfer.category import objects_folder

FOLDER = objects_folder() / "mug" / "demo"


def main():
    pose = yaml.safe_load((FOLDER / "pose.yaml").read_text())["camera_from_object"]
    camera = gt.Camera.load(FOLDER / "camera.yaml")
    result = gt.transfer_grasps(FOLDER / "picture.png", pose, "mug", camera=camera)
    print(f"{len(result.usable)} of {len(result.grasps)} grasps are usable")
    for grasp in result.grasps:
        print(f"  {grasp.name:22s} score {grasp.score:.2f}  {grasp.reason}")

    # The reconstruction stands in for the true mesh here; give your own mesh to judge the whole chain.
    trial = gt.simulate(result.usable[:1], result.mesh, result.gripper)[0]
    print(f"{result.usable[0].name}: {trial.status.name}, slipped {trial.slip_mm:.1f} mm")


if __name__ == "__main__":
    main()
