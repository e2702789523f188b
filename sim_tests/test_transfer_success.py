"""Grasps transferred from one picture are executed on the true mesh, through the public API."""

import numpy as np
import pytest
import yaml

import grasptransfer as gt
from grasptransfer.frames import invert
from grasptransfer.grasping import placed_at


@pytest.fixture(scope="module")
def mug():
    return gt.load_category("mug")


def test_a_grasp_far_beside_the_object_finds_nothing(mug):
    beside = np.eye(4)
    beside[:3, 3] = [0.5, 0.5, 0.0]
    (trial,) = gt.simulate([beside], mug.canonical, "panda")
    assert trial.status.name == "NO_CONTACT"


def test_a_grasp_from_the_bundled_picture_is_held_on_the_true_mug(mug):
    folder = mug.folder / "demo"
    result = gt.transfer_grasps(
        folder / "picture.png",
        gt.load_pose(folder / "pose.yaml"),
        mug,
        camera=gt.Camera.load(folder / "camera.yaml"),
    )
    truth = yaml.safe_load((folder / "truth.yaml").read_text())
    object_from_camera = invert(gt.load_pose(folder / "truth.yaml"))
    executed = [placed_at(grasp, object_from_camera @ grasp.camera_from_gripper) for grasp in result.usable]
    trials = gt.simulate(executed, mug.instance_mesh(truth["instance"]), result.gripper)
    assert sum(trial.held for trial in trials) >= len(trials) // 3
