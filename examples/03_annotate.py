"""Annotate grasps of a category without a browser, as a script would.

In the browser it is `grasptransfer annotate mug` (needs `pip install viser`): drag the gripper, watch the
checks, press save. Both edit the same session. Writes `my_grasps.yaml`, which `load_grasps` reads and a
person can edit by hand, and `my_grasps.png`: look at it.

Usage: python examples/03_annotate.py
"""

from pathlib import Path

import numpy as np

import grasptransfer as gt
from grasptransfer.annotator import Session
from grasptransfer.frames import rigid
from grasptransfer.grasping import expand_symmetry, load_grasps
from grasptransfer.report.grasp_pictures import GraspToDraw
from grasptransfer.report.grasp_sheet import grasp_sheet

FROM_ABOVE = np.diag([1.0, -1.0, -1.0])  # columns: closing along +x, y, approach along -z
PATH = Path("my_grasps.yaml")


def main():
    PATH.unlink(missing_ok=True)
    category, gripper = gt.load_category("mug"), gt.load_gripper("panda")
    session = Session(category, gripper, path=PATH)
    low, high = category.canonical.bounds

    # The first pose is a rough one at the wall opposite the handle (+x is the front), 1 cm below the rim.
    session.add("rim")
    session.move("rim", rigid(FROM_ABOVE, np.array([low[0] + 0.004, 0.0, high[2] - 0.010])))
    session.centre("rim")
    session.describe("rim", label="hand-over", approach_distance=0.12, confidence=0.9)
    # The grasp is as good when turned about the body's axis. The axis passes beside the origin, because the
    # bounding box includes the handle.
    session.turn("rim", [-40, 0, 40], point=np.array([-0.0157, 0.0, 0.0]))

    # A grasp beside the mug is a mistake: the annotator explains it.
    session.add("mistake")
    session.move("mistake", rigid(FROM_ABOVE, np.array([0.0, high[1] + 0.05, 0.0])))
    for name in session.names:
        found = session.measure(name)
        width = "-" if found.width is None else f"{found.width * 1e3:.1f} mm"
        print(f"{name:8s} {found.status.value:13s} width {width:8s} {found.reason}")
    session.remove("mistake")
    print(f"Saved {len(session.names)} grasp with its turns to {session.save()}")

    grasps = expand_symmetry(load_grasps(PATH, category=category))
    drawn = [GraspToDraw(g.name, g.canonical_from_gripper, gripper.approach_opening(g.width), True)
             for g in grasps if g.width is not None]  # fmt: skip
    print(f"Look at {grasp_sheet('my_grasps.png', category.canonical, drawn, gripper)}")


if __name__ == "__main__":
    main()
