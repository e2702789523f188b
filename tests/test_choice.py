"""Which usable grasp comes first: what the robot reaches, what is preferred, and no flip between equals."""

from dataclasses import replace

import numpy as np
import pytest
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.choice import MARGIN, distance, in_order, preferred
from grasptransfer.errors import SettingsError
from grasptransfer.frames import rigid
from grasptransfer.grasping import CheckStatus

WORLD_FROM_CAMERA = rigid(np.array([[0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0]]), np.array([0.1, 0.2, 0.5]))


@pytest.fixture(scope="module")
def picture():
    return see_mug(gt.load_category("mug"))[0]


@pytest.fixture(scope="module")
def flow():
    return gt.GraspTransfer("mug", estimator="rigid")


@pytest.fixture(scope="module")
def grasps(flow, picture):
    """Usable ones, all of the same score."""
    result = flow.transfer(picture, POSE, camera=CAMERA, world_from_camera=WORLD_FROM_CAMERA)
    free = replace(result.grasps[0].check, status=CheckStatus.FREE)
    return tuple(replace(grasp, score=0.8, check=free) for grasp in result.grasps)


def scored(grasps, *scores):
    return tuple(replace(grasp, score=score) for grasp, score in zip(grasps, scores, strict=False))


def test_a_grasp_out_of_reach_is_not_usable_and_says_which_pose(flow, picture):
    asked = []

    def never(world_from_gripper):
        asked.append(world_from_gripper)
        return False

    seen = {"camera": CAMERA, "world_from_camera": WORLD_FROM_CAMERA}
    before = flow.transfer(picture, POSE, **seen)
    after = flow.transfer(picture, POSE, **seen, reachable=never)
    assert len(asked) == len(before.usable) > 0
    assert not after.usable
    refused = {grasp.name: grasp for grasp in after.grasps}
    for grasp, pose in zip(before.usable, asked, strict=True):
        np.testing.assert_allclose(pose, grasp.world_from_gripper, atol=1e-12)
        assert refused[grasp.name].status is CheckStatus.OUT_OF_REACH
        assert "does not reach its grasp" in refused[grasp.name].reason


def test_the_pre_grasp_and_the_lift_must_be_reached_too(flow, picture):
    seen = {"camera": CAMERA, "world_from_camera": WORLD_FROM_CAMERA}
    free = flow.transfer(picture, POSE, **seen).usable
    limits = [max(pose[2, 3] for pose in (one.world_from_gripper, one.waypoints().pre_grasp)) for one in free]
    low = max(limits) + 1e-6  # the lift goes 10 cm higher than the grasp
    result = flow.transfer(picture, POSE, **seen, reachable=lambda pose: bool(pose[2, 3] <= low))
    high = [one for one in free if one.waypoints().lift[2, 3] > low]
    assert high
    reasons = {grasp.name: grasp.reason for grasp in result.grasps}
    assert all("its lift" in reasons[one.name] for one in high)


def test_reach_without_the_cameras_place_is_refused(flow, picture):
    with pytest.raises(SettingsError, match="world_from_camera"):
        flow.transfer(picture, POSE, camera=CAMERA, reachable=lambda pose: True)


@pytest.mark.parametrize("wrong", [None, "yes", 1])
def test_a_callback_must_answer_true_or_false(flow, picture, wrong):
    seen = {"camera": CAMERA, "world_from_camera": WORLD_FROM_CAMERA}
    with pytest.raises(SettingsError, match="True or False"):
        flow.transfer(picture, POSE, **seen, reachable=lambda pose: wrong)


def test_of_equals_the_one_annotated_first_leads(grasps):
    assert in_order(scored(grasps, 0.8, 0.8, 0.8))[0].name == grasps[0].name
    assert in_order(scored(grasps, 0.8, 0.800001))[0].name == grasps[1].name


def test_scores_fall_from_the_first_usable_grasp_on_and_have_six_decimals(flow, picture):
    found = [grasp.score for grasp in flow.transfer(picture, POSE, camera=CAMERA).usable]
    assert len(found) > 1
    assert found == sorted(found, reverse=True)
    assert found == [round(score, 6) for score in found]


def test_the_last_grasp_stays_unless_another_is_better_by_the_margin(grasps):
    last = grasps[1]
    near = in_order(scored(grasps, 0.8 + MARGIN * 0.9, 0.8))
    assert preferred(near, last)[0].name == last.name
    far = in_order(scored(grasps, 0.8 + MARGIN * 1.1, 0.8))
    assert preferred(far, last)[0].name == grasps[0].name


def test_a_last_grasp_that_is_no_longer_usable_gives_way(grasps):
    lost = replace(grasps[1], check=replace(grasps[1].check, status=CheckStatus.IN_COLLISION))
    others = tuple(one for one in grasps[2:] if distance(one, grasps[1]) > 0.1)[:1]
    assert others
    assert preferred(in_order((*others, lost)), grasps[1])[0].name == others[0].name


def test_two_fingers_swapped_are_the_same_grasp(grasps):
    turned = grasps[0].object_from_gripper @ np.diag([-1.0, -1.0, 1.0, 1.0])
    swapped = replace(grasps[0], warped=replace(grasps[0].warped, object_from_gripper=turned))
    assert distance(grasps[0], swapped) < 1e-9


def test_a_direction_decides_between_grasps_that_are_about_as_good(grasps):
    approaches = np.array([grasp.world_from_gripper[:3, 2] for grasp in grasps])
    wanted = approaches[int(np.argmin(approaches @ approaches[0]))]
    first = preferred(in_order(grasps), wanted)[0]
    assert first.world_from_gripper[:3, 2] @ wanted == pytest.approx(1)


@pytest.mark.parametrize("wrong", [(0, 0, 0), "top", (1, 2), (np.nan, 0, 1)])
def test_what_is_no_preference_is_refused(grasps, wrong):
    with pytest.raises(SettingsError, match="no preference"):
        preferred(grasps, wrong)


def test_frames_in_a_loop_keep_the_grasp(flow, picture):
    last, chosen = None, []
    for turn in np.deg2rad([0.0, 0.4, -0.3, 0.5]):
        pose = POSE @ rigid(
            np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]]),
            np.zeros(3),
        )
        last = flow.transfer(picture, pose, camera=CAMERA, prefer=last).usable[0]
        chosen.append(last.name)
    assert len(set(chosen)) == 1
