"""Depth on top of RGB: it corrects what the picture leaves open, and lets go what does not fit."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.benchmark.seen_instances import load_instance, observe_instance
from grasptransfer.frames import rotation_angle
from grasptransfer.perception.estimate import ShapeEstimate, with_certain_pose
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.rgbd import RgbdEstimator


@pytest.fixture(scope="module")
def renderer():
    with Renderer() as made:
        yield made


@pytest.fixture(scope="module")
def mug():
    return load_instance("mug", "mug_0014", None)


@pytest.fixture(scope="module")
def seen(mug, renderer):
    """What a camera sees of it, and its true latent."""
    observation, pose = observe_instance(mug, 40, views=74, renderer=renderer)
    return observation, pose, mug.category.shape_space.encode(mug.true_field.weights)


def _vague(mug, spread: float):
    """An estimator that knows the mean shape alone, this uncertain."""
    space = mug.category.shape_space
    latent, covariance = np.zeros(space.n_modes), spread**2 * np.eye(space.n_modes)

    def estimate(observation):
        assert observation.depth is None  # RGB must not see depth
        return ShapeEstimate(
            space.field(latent),
            observation.camera_from_object,
            latent,
            with_certain_pose(covariance),
            mask=observation.mask,
        )

    return estimate


def _visible_error(mug, estimate, seen) -> float:
    """RMS distance of the warped visible canonical points to where they belong, in the camera's frame [m]."""
    points = mug.category.shape_space.control_points
    truth = mug.true_field(points)
    _, pose, _ = seen
    placed = (
        estimate.field(points) @ estimate.camera_from_object[:3, :3].T + estimate.camera_from_object[:3, 3]
    )
    towards = pose[:3, 3] - (truth @ pose[:3, :3].T + pose[:3, 3])
    near = (towards * [0, 0, 1]).sum(1) > 0  # the half nearer to the camera
    true_placed = truth @ pose[:3, :3].T + pose[:3, 3]
    return float(np.sqrt(np.square(placed - true_placed)[near].sum(1).mean()))


def test_depth_finds_the_shape_that_the_picture_left_open(mug, seen, renderer):
    observation, _, _ = seen
    rgb = _vague(mug, 1.0)
    first = rgb(replace(observation, depth=None))
    fused = RgbdEstimator(mug.category, rgb, renderer, refine_pose=False)(observation)
    assert _visible_error(mug, fused, seen) < 0.4 * _visible_error(mug, first, seen)
    assert np.trace(fused.latent_covariance) < np.trace(first.latent_covariance)
    assert fused.timings["depth"] > 0


def test_a_wrong_pose_is_moved_back(mug, seen, renderer):
    observation, pose, latent = seen
    space = mug.category.shape_space
    told = pose.copy()
    told[:3, 3] += [0.003, -0.004, 0.015]

    def knows_the_shape(observation):
        narrow = 1e-4 * np.eye(space.n_modes)
        return ShapeEstimate(
            space.field(latent), told, latent, with_certain_pose(narrow), mask=observation.mask
        )

    fused = RgbdEstimator(mug.category, knows_the_shape, renderer)(observation)
    before, after = (np.linalg.norm(p[:3, 3] - pose[:3, 3]) for p in (told, fused.camera_from_object))
    assert after < 0.35 * before
    assert rotation_angle(fused.camera_from_object[:3, :3] @ pose[:3, :3].T) < np.deg2rad(2)


def test_without_depth_it_is_the_rgb_estimate(mug, seen, renderer):
    observation, _, _ = seen
    rgb = _vague(mug, 1.0)
    estimator = RgbdEstimator(mug.category, rgb, renderer)
    for depth in (None, np.zeros_like(observation.depth)):
        fused = estimator(replace(observation, depth=depth))
        np.testing.assert_array_equal(fused.latent, np.zeros_like(fused.latent))
        np.testing.assert_array_equal(fused.camera_from_object, observation.camera_from_object)


def test_depth_of_a_wall_behind_glass_is_let_go(mug, seen, renderer):
    observation, _, latent = seen
    space = mug.category.shape_space

    def knows_the_shape(observation):
        covariance = 0.01 * np.eye(space.n_modes)
        return ShapeEstimate(
            space.field(latent),
            observation.camera_from_object,
            latent,
            with_certain_pose(covariance),
            mask=observation.mask,
        )

    rng = np.random.default_rng(0)
    rows = np.repeat(rng.random((60, 80)) < 0.6, 8, 0)
    through = np.repeat(rows, 8, 1)
    depth = np.where(through & observation.mask, observation.depth + 0.25, observation.depth)
    estimator = RgbdEstimator(mug.category, knows_the_shape, renderer)
    clean, fused = estimator(observation), estimator(replace(observation, depth=depth))
    moved = np.linalg.norm(fused.camera_from_object[:3, 3] - observation.camera_from_object[:3, 3])
    assert moved < 0.006  # the wall is 25 cm away
    assert _visible_error(mug, fused, seen) < _visible_error(mug, clean, seen) + 0.004


def test_it_is_an_estimator_of_the_main_flow(seen):
    observation, _, _ = seen
    flow = gt.GraspTransfer("mug", estimator="rgbd", refine_pose=False, device="cpu")
    result = flow.transfer(
        observation.image,
        observation.camera_from_object,
        camera=observation.camera,
        mask=observation.mask,
        depth=observation.depth,
    )
    assert {"network", "depth", "warp", "check", "rank", "total"} <= result.timings.keys()
    assert result.latent is not None
    assert len(result.grasps) > 0
