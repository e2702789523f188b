"""Draw a few executed trials: the way in, the closed fingers, the lift, and the turn in the air.

Grasps annotated on the canonical models go to instances by their known fields and are executed in PyBullet
on the instances' own meshes. Writes `trials.png`, a line for each trial: look at it.

Usage: python examples/11_picture_of_trials.py [--quick]
"""

import sys

import grasptransfer as gt
from grasptransfer.grasping import check_grasps, load_grasps, load_gripper, refine_grasps, warp_grasps
from grasptransfer.report.trial_sheet import ExecutedTrial, trial_sheet

SHOWN = (
    ("mug", "mug_0028", "handle_front"),
    ("drill", "drill_0029", "handle_back"),
    ("bottle", "bottle_0014", "pour"),
    ("camera", "camera_0033", "side_grip"),
)
FRAMES = 20  # per second


def execute(name: str, instance: str, grasp: str, gripper) -> ExecutedTrial:
    category = gt.load_category(name)
    annotated = [g for g in load_grasps(category.grasps_path, category=category) if g.name == grasp]
    mesh = category.instance_mesh(instance)
    grasps = refine_grasps(warp_grasps(annotated, category.field(instance)), mesh, gripper)
    checks = check_grasps(grasps, mesh, gripper)
    (trial,) = gt.simulate(grasps, mesh, gripper, frames=FRAMES)
    print(f"{instance}, {grasp}: {checks[0].status.value}; executed: {trial.detail}")
    return ExecutedTrial(trial, mesh, f"{instance}, {grasp}: {trial.status.value}")


def main():
    gripper = load_gripper("panda")
    shown = SHOWN[:1] if "--quick" in sys.argv else SHOWN
    trials = [execute(*names, gripper) for names in shown]
    print(f"Look at {trial_sheet('trials.png', trials, gripper)}")


if __name__ == "__main__":
    main()
