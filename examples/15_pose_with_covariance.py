"""Say how sure the pose is: exact, in metres and degrees, or as a covariance.

A pose estimator that gives a covariance knows more than its size: from one RGB picture the distance is much
less sure than the place across the ray. Here the given pose is 3 cm too near. One picture cannot tell size
from distance, and so cannot put it right; but told how unsure the pose is, the result says so, and states
lower chances. A plane on which the mug stands finds the distance. Writes `pose.yaml` with the covariance in
it, as `grasptransfer transfer --pose` reads it.

Usage: python examples/15_pose_with_covariance.py
"""

from pathlib import Path

import numpy as np
import yaml

import grasptransfer as gt
from grasptransfer.category import objects_folder
from grasptransfer.poses import pose_as_yaml, read_pose

DEMO = objects_folder() / "mug" / "demo"


def covariance_along_the_ray(pose: np.ndarray, along: float, across: float, degrees: float) -> np.ndarray:
    """(6, 6): turn about the object's origin [rad], then shift [m], along the camera's axes."""
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    on_ray = np.outer(ray, ray)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.deg2rad(degrees) ** 2 * np.eye(3)
    covariance[3:, 3:] = along**2 * on_ray + across**2 * (np.eye(3) - on_ray)
    return covariance


def main():
    camera, true_pose = gt.Camera.load(DEMO / "camera.yaml"), gt.load_pose(DEMO / "truth.yaml")
    flow = gt.GraspTransfer("mug")
    true_mesh = flow.category.instance_mesh("mug_0020")
    given = true_pose.copy()
    given[:3, 3] *= 1 - 0.03 / np.linalg.norm(given[:3, 3])
    covariance = covariance_along_the_ray(given, along=0.03, across=0.003, degrees=2.0)
    Path("pose.yaml").write_text(yaml.safe_dump(pose_as_yaml(given, covariance)))
    known = read_pose("pose.yaml")

    table = true_pose @ [0, 0, true_mesh.bounds[0, 2], 1]
    standing = gt.Scene(support_plane=(table[:3], true_pose[:3, 2]), stands=True)
    cases = {
        "exact": {"pose_sigma": 0},
        "unsaid": {"pose_sigma": None},  # it errs as the poses of real RGB estimators do
        "3 cm, 2 degrees": {"pose_sigma": (0.03, 2.0)},
        "covariance": {"pose_sigma": known.pose_sigma},
        "and a table": {"pose_sigma": known.pose_sigma, "scene": standing},
    }
    for name, said in cases.items():
        result = flow.transfer(DEMO / "picture.png", known.camera_from_object, camera=camera, **said)
        off = np.linalg.norm(result.camera_from_object[:3, 3] - true_pose[:3, 3])
        size = (result.mesh.extents - true_mesh.extents).mean()
        print(f"{name:16s} pose off by {1e3 * off:4.1f} mm, sure to {_text(result.pose_sigma_posterior)}; "
              f"size off by {1e3 * size:+5.1f} mm; best score {result.grasps[0].score:.2f}")  # fmt: skip


def _text(sigma) -> str:
    return f"{1e3 * sigma.along_ray:.1f} mm along the ray, {sigma.turn:.1f} degrees"


if __name__ == "__main__":
    main()
