"""Two pictures of one mug, taken by a camera that an arm moved around it.

One picture does not tell size from distance. Here the given pose is 4 cm too far away. The arm knows how the
camera moved, so both poses are wrong by the same: the pictures together find how far the mug is, and how
large. Writes `two_pictures.html`: look at it.

Usage: python examples/13_two_pictures_of_one_mug.py
"""

import numpy as np

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import invert

CAMERA = gt.Camera.from_fov(640, 480, np.deg2rad(60))
INSTANCE = "mug_0020"  # no training saw it


def photograph(mesh, camera_from_object: np.ndarray) -> np.ndarray:
    """RGB picture of the mug before a grey wall."""
    with Renderer() as renderer:
        seen = renderer.render(mesh, CAMERA, camera_from_object)
    return seen.over(np.full((CAMERA.height, CAMERA.width, 3), 130, np.uint8))


def main():
    flow = gt.GraspTransfer("mug")
    mesh = flow.category.instance_scene(INSTANCE)
    first, second = look_at(0.45, 0.5, 0.6), look_at(0.45, 1.4, 0.6)
    pictures = [photograph(mesh, pose) for pose in (first, second)]

    # What the robot knows: one estimated pose, and from the arm how the camera went on.
    given = first.copy()
    given[2, 3] += 0.04
    second_from_first = second @ invert(first)
    poses = [given, second_from_first @ given]

    known = {"camera": CAMERA, "pose_sigma": (0.03, 3.0)}  # the pose is sure to 3 cm and 3 degrees
    alone = flow.transfer(pictures[0], poses[0], **known)
    together = flow.transfer(pictures, poses, views="moved camera", **known)
    true_size = flow.category.instance_mesh(INSTANCE).extents
    for name, result in (("one picture", alone), ("both", together)):
        off = np.linalg.norm(result.camera_from_object[:3, 3] - first[:3, 3])
        size = np.abs(result.mesh.extents - true_size).max()
        sigma, best = result.pose_sigma_posterior, result.grasps[0]
        assert sigma is not None
        print(f"{name:12s} pose off by {1e3 * off:4.1f} mm (sure to {1e3 * sigma.along_ray:.1f} on the ray), "
              f"size by {1e3 * size:4.1f} mm; best grasp {best.name}, score {best.score:.2f}")  # fmt: skip
    print(f"Look at {together.report('two_pictures.html')}")


if __name__ == "__main__":
    main()
