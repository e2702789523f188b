"""Where the robot goes: waypoints in camera and world, and MoveIt's message."""

import numpy as np
import pytest
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.errors import GraspFileError, PoseError, SettingsError
from grasptransfer.frames import invert, rigid
from grasptransfer.grasping import load_grasps, save_grasps

WORLD_FROM_CAMERA = rigid(np.array([[0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0]]), np.array([0.1, 0.2, 0.5]))


@pytest.fixture(scope="module")
def picture():
    return see_mug(gt.load_category("mug"))[0]


@pytest.fixture(scope="module")
def flow():
    return gt.GraspTransfer("mug", estimator="rigid")


def test_poses_in_the_world_are_those_in_the_camera_moved(flow, picture):
    # The world says which way is up, else the object does: here both are given the same.
    up = WORLD_FROM_CAMERA[2, :3]
    here = flow.transfer(picture, POSE, camera=CAMERA, physics={"up": up})
    there = flow.transfer(picture, POSE, camera=CAMERA, world_from_camera=WORLD_FROM_CAMERA)
    for grasp, same in zip(here.grasps, there.grasps, strict=True):
        np.testing.assert_allclose(
            same.world_from_gripper, WORLD_FROM_CAMERA @ grasp.camera_from_gripper, atol=1e-12
        )
    with pytest.raises(SettingsError, match="world_from_camera"):
        _ = here.grasps[0].world_from_gripper


def test_a_reflected_camera_pose_is_refused(flow, picture):
    with pytest.raises(PoseError, match="world_from_camera"):
        flow.transfer(picture, POSE, camera=CAMERA, world_from_camera=np.diag([1.0, 1.0, -1.0, 1.0]))


@pytest.mark.parametrize("world_from_camera", [None, WORLD_FROM_CAMERA])
def test_waypoints_come_in_along_the_approach_and_lift_straight_up(flow, picture, world_from_camera):
    grasp = flow.transfer(picture, POSE, camera=CAMERA, world_from_camera=world_from_camera).grasps[0]
    steps = grasp.waypoints()
    assert steps.frame == ("camera" if world_from_camera is None else "world")
    way = steps.grasp[:3, 3] - steps.pre_grasp[:3, 3]
    np.testing.assert_allclose(way, grasp.approach_distance * steps.grasp[:3, 2], atol=1e-12)
    lifted = steps.lift[:3, 3] - steps.grasp[:3, 3]
    up = POSE[:3, 2] if world_from_camera is None else [0, 0, 1]
    np.testing.assert_allclose(lifted, 0.1 * np.array(up), atol=1e-12)
    for pose in (steps.pre_grasp, steps.lift):
        np.testing.assert_array_equal(pose[:3, :3], steps.grasp[:3, :3])
    assert steps.opening >= steps.width


def test_moveits_message_holds_the_pose_of_the_base_link(flow, picture):
    grasp = flow.transfer(picture, POSE, camera=CAMERA, world_from_camera=WORLD_FROM_CAMERA).grasps[0]
    message = grasp.to_moveit(frame_id="panda_link0")
    pose = message["grasp_pose"]["pose"]
    base = grasp.world_from_gripper @ invert(flow.gripper.base_from_tcp)
    np.testing.assert_allclose(list(pose["position"].values()), base[:3, 3], atol=1e-12)
    assert message["grasp_pose"]["header"]["frame_id"] == "panda_link0"
    assert message["grasp_quality"] == grasp.score
    assert message["pre_grasp_approach"]["desired_distance"] == pytest.approx(grasp.approach_distance)
    fingers = message["pre_grasp_posture"]
    assert sum(fingers["points"][0]["positions"]) == pytest.approx(grasp.opening, abs=1e-4)
    assert set(fingers["joint_names"]) == {joint.name for joint in flow.gripper.finger_joints}


def test_a_grasp_file_of_ones_own_takes_the_place_of_the_categorys(picture, tmp_path):
    category = gt.load_category("mug")
    own = load_grasps(category.grasps_path)[:1]
    path = save_grasps(own, tmp_path / "own.yaml", category="mug", canonical_sha256=category.canonical_sha256)
    result = gt.transfer_grasps(picture, POSE, "mug", camera=CAMERA, grasps=path, estimator="rigid")
    assert {grasp.name.split("/")[0] for grasp in result.grasps} == {own[0].name}
    other = save_grasps(own, tmp_path / "other.yaml", category="bottle")
    with pytest.raises(GraspFileError, match="another category"):
        gt.GraspTransfer("mug", grasps=other)
