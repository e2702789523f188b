"""Use a gripper of your own: its URDF, and a small YAML that says what a URDF cannot.

The URDF here is a palm with two sliding fingers, written on the spot; yours may have meshes, linkages and
mimic joints. The YAML names the TCP (between the pads, +z approach, +x closing), the finger joints with their
ratios, the opening range and the pads. Writes `slim.urdf`, `slim.yaml` and `slim.png`: look at it.

Usage: python examples/04_own_gripper.py
"""

from pathlib import Path

import grasptransfer as gt
from grasptransfer.category import objects_folder
from grasptransfer.grasping.frames_table import draw_frames, frames_table

FINGER = """
  <link name="{name}"><collision><origin xyz="0 {centre} 0.04"/><geometry><box size="0.01 0.006 0.08"/>
  </geometry></collision></link>
  <joint name="{name}_slide" type="prismatic"><parent link="palm"/><child link="{name}"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 {side} 0"/>
    <limit lower="0" upper="0.025" effort="40" velocity="0.1"/></joint>"""
URDF = """<robot name="slim">
  <link name="palm"><collision><origin xyz="0 0 0.025"/><geometry><box size="0.04 0.09 0.05"/></geometry>
  </collision></link>{fingers}
</robot>"""
YAML = """
name: slim
urdf: slim.urdf
base_link: palm
base_from_tcp:              # the fingers close along the palm's y: a quarter turn about z
  position: [0, 0, 0.12]
  orientation: {w: 0.70710678, xyz: [0, 0, 0.70710678]}
joints:                     # joint = ratio x driver + offset; the first one drives
  left_slide: {ratio: 1}
  right_slide: {ratio: 1}
opening: [0, 0.05]
force_limit: 40
pads:                       # first the one on the TCP's -x side, which is the palm's -y
  - {link: right, centre: [0, 0, 0.07], size: [0.01, 0.02]}
  - {link: left, centre: [0, 0, 0.07], size: [0.01, 0.02]}
"""
DEMO = objects_folder() / "mug" / "demo"


def main():
    fingers = [FINGER.format(name=name, side=side, centre=0.003 * side)
               for name, side in (("left", 1), ("right", -1))]  # fmt: skip
    Path("slim.urdf").write_text(URDF.format(fingers="".join(fingers)))
    Path("slim.yaml").write_text(YAML)
    gripper = gt.load_gripper("slim.yaml")
    print(frames_table(gripper))
    print(f"Look at {draw_frames(gripper, 'slim.png')}\n")

    # Grasps are annotated at the TCP, so they go from one gripper to the other as they are.
    camera, pose = gt.Camera.load(DEMO / "camera.yaml"), gt.load_pose(DEMO / "pose.yaml")
    flow = gt.GraspTransfer("mug", gripper="panda")
    for hand in ("panda", gripper):
        flow = gt.GraspTransfer("mug", gripper=hand, estimator=flow.estimator)
        result = flow.transfer(DEMO / "picture.png", pose, camera=camera)
        print(f"{result.gripper.name}: {len(result.usable)} of {len(result.grasps)} grasps are usable")
        for grasp in result.grasps:
            print(f"  {grasp.name:22s} score {grasp.score:.2f}  {grasp.reason}")


if __name__ == "__main__":
    main()
