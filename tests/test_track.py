"""A track keeps what pictures leave known: more sides make the shape surer, the same side again does not."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import PoseError, SettingsError
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.workshop.benchmark.given_poses import ESTIMATED
from grasptransfer.workshop.benchmark.seen_instances import load_instance, observe_instance


@pytest.fixture(scope="module")
def flow():
    return gt.GraspTransfer("mug", device="cpu")


@pytest.fixture(scope="module")
def pictures():
    """Two sides of a mug that no training saw, with one error of the pose, and the true first pose."""
    instance = load_instance("mug", "mug_0014")
    with Renderer() as renderer:
        seen, pose = observe_instance(instance, 40, renderer=renderer, noise=ESTIMATED, pictures=2)
    return seen.without("mask", "depth").pictures, pose


def _given(picture):
    return {
        "image": picture.image,
        "pose": picture.camera_from_object,
        "camera": picture.camera,
        "box": picture.box,
    }


def _unknown(result) -> float:
    """Of size and proportions, which come first among the modes."""
    return float(np.trace(result.latent_covariance[:5, :5]))


def test_the_first_picture_of_a_track_is_a_picture_by_itself(flow, pictures):
    first = pictures[0][0]
    tracked, alone = flow.track().transfer(**_given(first)), flow.transfer(**_given(first))
    np.testing.assert_array_equal(tracked.latent, alone.latent)
    np.testing.assert_array_equal(tracked.camera_from_object, alone.camera_from_object)


@pytest.mark.parametrize("views", ["moved camera", "separate"])
def test_another_side_makes_the_shape_surer_and_the_same_picture_again_does_not(flow, pictures, views):
    first, second = pictures[0]
    track = flow.track(views=views)
    start, again, other = (track.transfer(**_given(picture)) for picture in (first, first, second))
    assert _unknown(again) > 0.99 * _unknown(start)
    assert _unknown(other) < 0.9 * _unknown(start)


def test_a_track_of_two_sides_ends_near_both_together(flow, pictures):
    both = [_given(picture) for picture in pictures[0]]
    track = flow.track(pose_noise=0)
    results = [track.transfer(**one) for one in both]
    together = flow.transfer(**{key: [one[key] for one in both] for key in both[0]})
    apart = np.abs(results[1].latent - together.latent) / np.sqrt(np.diag(together.latent_covariance))
    # The network compares other assumed shapes with the pictures: the answers differ, within what is unknown.
    assert np.sqrt(np.mean(apart**2)) < 0.5
    in_second = both[1]["pose"] @ np.linalg.inv(both[0]["pose"]) @ together.camera_from_object
    assert np.linalg.norm((results[1].camera_from_object - in_second)[:3, 3]) < 0.004


def test_a_wrong_picture_leaves_the_track_as_it_was(flow, pictures):
    first = _given(pictures[0][0])
    track = flow.track()
    track.transfer(**first)
    before = track.posterior
    with pytest.raises(PoseError):
        track.transfer(**(first | {"pose": np.zeros((4, 4))}))
    assert track.posterior is before


def test_wrong_settings_of_a_track_are_refused(flow):
    with pytest.raises(SettingsError, match="moved camera, separate"):
        flow.track(views="video")
    with pytest.raises(PoseError, match="pose_noise"):
        flow.track(pose_noise=(-1, 2))
    with pytest.raises(SettingsError, match="rgb, rgbd"):
        gt.GraspTransfer("mug", estimator="rigid").track()


def test_estimators_of_one_picture_refuse_several(pictures):
    both = [_given(picture) for picture in pictures[0]]
    with pytest.raises(SettingsError, match="one picture at a time"):
        gt.GraspTransfer("mug", estimator="rigid").transfer(
            **{key: [one[key] for one in both] for key in both[0]}  # pyright: ignore[reportArgumentType]
        )


def test_an_estimator_that_keeps_nothing_is_named(flow, pictures):
    class Forgetful:
        def __call__(self, observation) -> ShapeEstimate:
            return replace(flow.estimator(observation), posterior=None)

    track = gt.GraspTransfer("mug", estimator=Forgetful()).track()
    with pytest.raises(SettingsError, match="leaves nothing known"):
        track.transfer(**_given(pictures[0][0]))


def test_an_object_that_stands_on_a_plane_is_found_where_it_stands(flow, pictures):
    first, true_pose = _given(pictures[0][0]), pictures[1]
    instance = load_instance("mug", "mug_0014")
    bottom = true_pose[:3, :3] @ [0, 0, instance.solid.bounds[0, 2]] + true_pose[:3, 3]
    scene = gt.Scene(support_plane=(bottom, true_pose[:3, 2]), stands=True, stands_sigma=0.001)
    given_pose = first["pose"].copy()
    given_pose[:3, 3] *= 1.06
    off = []
    for known in (None, scene):
        result = flow.transfer(**(first | {"pose": given_pose, "scene": known}), pose_sigma=(0.03, 3))
        off.append(np.linalg.norm(result.camera_from_object[:3, 3] - true_pose[:3, 3]))
    assert off[1] < 0.6 * off[0]
