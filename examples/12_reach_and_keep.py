"""Take only grasps that the arm reaches, and keep the chosen one from picture to picture.

`reachable` is a callback on the TCP's pose in the world: here the analytical inverse kinematics of a Franka
Panda (`pip install frankik`), or, without that package, a rough shell around its shoulder. `prefer` is the
grasp chosen last: it stays unless another is better by more than 0.05.

Usage: python examples/12_reach_and_keep.py
"""

import numpy as np

import grasptransfer as gt
from grasptransfer.category import objects_folder
from grasptransfer.frames import invert, rigid

DEMO = objects_folder() / "mug" / "demo"
SWAPPED = np.diag([-1.0, -1.0, 1.0, 1.0])  # the hand turned by half about its approach: the same grasp
SHOULDER, NEAREST, FARTHEST = np.array([0.0, 0.0, 0.333]), 0.25, 0.80  # m


def reach_of_panda():
    """A callback on `world_from_gripper`; the world is the robot's base."""
    hand_from_gripper = gt.load_gripper("panda").base_from_tcp
    try:
        from frankik import FrankaKinematics, RobotType  # pyright: ignore[reportMissingImports]
    except ImportError:
        print("frankik is not installed: reach is judged by distance alone")
        return lambda pose: bool(NEAREST < np.linalg.norm(pose[:3, 3] - SHOULDER) < FARTHEST)
    arm = FrankaKinematics(robot_type=RobotType.PANDA)

    def reachable(world_from_gripper: np.ndarray) -> bool:
        hands = [world_from_gripper @ turn @ invert(hand_from_gripper) for turn in (np.eye(4), SWAPPED)]
        return any(arm.inverse(hand, q0=arm.q_home, global_solution=True) is not None for hand in hands)

    return reachable


def main():
    camera, pose = gt.Camera.load(DEMO / "camera.yaml"), gt.load_pose(DEMO / "pose.yaml")
    flow = gt.GraspTransfer("mug")
    reachable = reach_of_panda()
    last = None
    for forward in (0.50, 0.52, 0.95):  # m from the robot's base to the mug
        world_from_object = rigid(np.eye(3), np.array([forward, 0.0, 0.05]))
        result = flow.transfer(
            DEMO / "picture.png",
            pose,
            camera=camera,
            world_from_camera=world_from_object @ invert(pose),
            reachable=reachable,
            prefer=last,
        )
        beyond = [grasp for grasp in result.grasps if grasp.status.value == "out of reach"]
        print(f"mug {forward:.2f} m away: {len(result.usable)} usable, {len(beyond)} out of reach")
        if beyond:
            print(f"  {beyond[0].name}: {beyond[0].reason}")
        if result.usable:
            last = result.usable[0]
            print(f"  take {last.name}, expected success {last.score:.0%}")


if __name__ == "__main__":
    main()
