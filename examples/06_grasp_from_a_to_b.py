"""Move a grasp from one instance to another: what was tried on mug A is used on mug B.

Both mugs are seen in one picture each. Their fields meet at the canonical model, so `register_pair` maps
any point of A to B, and a grasp placed on A by hand goes along: no canonical model, no annotation.
Writes `on_a.png` and `on_b.png`: look at them.

Usage: python examples/06_grasp_from_a_to_b.py
"""

import numpy as np

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import rigid
from grasptransfer.grasping import (
    CollisionWorld,
    Grasp,
    check_grasps,
    on_canonical,
    refine_grasps,
    warp_grasps,
)
from grasptransfer.report.grasp_pictures import GraspToDraw
from grasptransfer.report.grasp_sheet import grasp_sheet

CAMERA = gt.Camera.from_fov(640, 480, np.deg2rad(50))
POSE = look_at(0.45, np.deg2rad(50), np.deg2rad(30))  # camera_from_object [m]


def photograph(category: gt.Category, name: str, renderer: Renderer) -> np.ndarray:
    """A picture of a mug on grey, where yours would come from a camera."""
    ground = np.full((480, 640, 3), 150, np.uint8)
    return renderer.render(category.instance_scene(name), CAMERA, POSE).over(ground)


def placed_on(mesh) -> Grasp:
    """A grasp by the handle, set on this very mug: closing along y, coming from the front."""
    front = mesh.bounds[1, 0]
    approach_back = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])  # columns: closing, y, approach
    return Grasp("handle", "handle", rigid(approach_back, np.array([front - 0.006, 0.0, 0.0])), 0.02)


def main():
    category, gripper = gt.load_category("mug"), gt.load_gripper("panda")
    flow, (first, second) = gt.GraspTransfer(category), category.test[:2]
    with Renderer() as renderer:
        a = flow.transfer(photograph(category, first, renderer), POSE, camera=CAMERA)
        b = flow.transfer(photograph(category, second, renderer), POSE, camera=CAMERA)
    print(f"A is {first}, {a.mesh.extents * 1e3} mm; B is {second}, {b.mesh.extents * 1e3} mm")

    on_a = refine_grasps(on_canonical([placed_on(a.mesh)]), a.mesh, gripper)[0]  # A plays the canonical
    chosen = Grasp("handle", "handle", on_a.object_from_gripper, on_a.width, contacts=on_a.contacts)
    a_to_b = gt.register_pair(a, b)
    world = CollisionWorld(b.mesh)
    on_b = refine_grasps(warp_grasps([chosen], a_to_b), world, gripper)[0]
    for name, grasp, mesh in (("a", on_a, a.mesh), ("b", on_b, world)):
        check = check_grasps([grasp], mesh, gripper)[0]
        print(f"on {name.upper()}: TCP at {grasp.object_from_gripper[:3, 3] * 1e3} mm: {check.reason}")
        drawn = GraspToDraw(f"on {name.upper()}", grasp.object_from_gripper, check.opening, check.usable)
        solid = a.mesh if name == "a" else b.mesh
        print(f"Look at {grasp_sheet(f'on_{name}.png', solid, [drawn], gripper)}")
    trial = gt.simulate([on_b], category.instance_mesh(second), gripper)[0]
    print(f"executed on the true mesh of B: {trial.status.value}, slipped {trial.slip_mm:.1f} mm")


if __name__ == "__main__":
    np.set_printoptions(precision=0, suppress=True)
    main()
