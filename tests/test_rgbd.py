"""Depth on top of RGB: it corrects what the picture leaves open, and lets go what does not fit."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.frames import rotation_angle
from grasptransfer.perception.estimate import ShapeEstimate, with_certain_pose
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.rgbd import RgbdEstimator
from grasptransfer.registration import DeformationField
from grasptransfer.workshop import objects
from grasptransfer.workshop.benchmark.errors_of_shape import outer_surface, shape_error
from grasptransfer.workshop.benchmark.glass import GlassSettings, sense
from grasptransfer.workshop.benchmark.seen_instances import (
    Instance,
    load_instance,
    observe_instance,
    see_instance,
)
from grasptransfer.workshop.training.scenes import PoseNoise


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
    observation, pose = observe_instance(mug, 40, renderer=renderer)
    return observation, pose, mug.category.shape_space.encode(mug.true_field.weights)


def _believing(mug, latent, covariance, *, pose=None):
    """An estimator that believes this of any picture."""

    def estimate(observation):
        assert observation.depth is None  # RGB must not see depth
        told = observation.camera_from_object if pose is None else pose
        field = mug.category.shape_space.field(latent)
        return ShapeEstimate(field, told, latent, covariance, mask=observation.mask)

    return estimate


def _vague(mug, spread: float):
    """It knows the mean shape alone, this uncertain."""
    modes = mug.category.shape_space.n_modes
    return _believing(mug, np.zeros(modes), with_certain_pose(spread**2 * np.eye(modes)))


def _doubting(modes: int, *, turn=0.0, shift=0.0, latent=0.0):
    """A joint covariance of independent errors with these standard deviations [rad, m, 1]."""
    return np.diag(np.concatenate([np.full(3, turn), np.full(3, shift), np.full(modes, latent)]) ** 2)


def _visible_error(mug, estimate, seen) -> float:
    """RMS distance of the warped visible canonical points to where they belong, in the camera's frame [m]."""
    points = mug.category.shape_space.control_points
    truth = mug.true_field(points)
    _, pose, _ = seen
    placed = (
        estimate.field(points) @ estimate.camera_from_object[:3, :3].T + estimate.camera_from_object[:3, 3]
    )
    true_placed = truth @ pose[:3, :3].T + pose[:3, 3]
    near = true_placed[:, 2] < pose[2, 3]  # the half nearer to the camera
    return float(np.sqrt(np.square(placed - true_placed)[near].sum(1).mean()))


def _patches(share: float, shape: tuple[int, int]) -> np.ndarray:
    """Patches of 8 px that cover this share of a picture."""
    rng = np.random.default_rng(0)
    coarse = rng.random((shape[0] // 8, shape[1] // 8)) < share
    return np.repeat(np.repeat(coarse, 8, 0), 8, 1)


def test_depth_finds_the_shape_that_the_picture_left_open(mug, seen):
    observation, pose, _ = seen
    rgb = _vague(mug, 1.0)
    first = rgb(replace(observation, depth=None))
    fused = RgbdEstimator(mug.category, rgb)(observation)
    assert _visible_error(mug, fused, seen) < 0.4 * _visible_error(mug, first, seen)
    assert fused.latent_covariance is not None
    assert first.latent_covariance is not None
    assert np.trace(fused.latent_covariance) < np.trace(first.latent_covariance)
    assert fused.timings["depth"] > 0
    np.testing.assert_allclose(fused.camera_from_object, pose, atol=1e-12)  # one without doubt stays


def test_a_wrong_pose_is_moved_back(mug, seen):
    observation, pose, latent = seen
    told = pose.copy()
    told[:3, 3] += [0.003, -0.004, 0.015]
    doubt = _doubting(len(latent), turn=np.deg2rad(1.5), shift=0.01, latent=0.01)
    fused = RgbdEstimator(mug.category, _believing(mug, latent, doubt, pose=told))(observation)
    before, after = (np.linalg.norm(p[:3, 3] - pose[:3, 3]) for p in (told, fused.camera_from_object))
    assert after < 0.2 * before
    assert rotation_angle(fused.camera_from_object[:3, :3] @ pose[:3, :3].T) < np.deg2rad(1)
    assert np.trace(fused.covariance[3:6, 3:6]) < 0.1 * np.trace(doubt[3:6, 3:6])


def test_depth_tells_size_from_distance(mug, seen):
    """A picture knows their ratio: a mug 5 % larger is 5 % farther away."""
    observation, pose, latent = seen
    space = mug.category.shape_space
    larger = 1.05
    points = space.control_points
    scaled = mug.true_field(points) * larger
    as_large = space.map_estimate(points, scaled - points, 1e-3).mean
    told = pose.copy()
    told[:3, 3] *= larger
    together = np.concatenate([np.zeros(3), told[:3, 3] - pose[:3, 3], as_large - latent])
    belief = _doubting(len(latent), turn=1e-3, shift=5e-4, latent=0.02) + np.outer(together, together)
    fused = RgbdEstimator(mug.category, _believing(mug, as_large, belief, pose=told))(observation)
    left = np.linalg.norm(fused.latent - latent) / np.linalg.norm(as_large - latent)
    assert left < 0.25
    assert abs(fused.camera_from_object[2, 3] - pose[2, 3]) < 0.2 * (told[2, 3] - pose[2, 3])


def test_without_depth_it_is_the_rgb_estimate(mug, seen):
    observation, _, _ = seen
    estimator = RgbdEstimator(mug.category, _vague(mug, 1.0))
    for depth in (None, np.zeros_like(observation.depth)):
        fused = estimator(replace(observation, depth=depth))
        np.testing.assert_array_equal(fused.latent, np.zeros_like(fused.latent))
        np.testing.assert_array_equal(fused.camera_from_object, observation.camera_from_object)


@pytest.mark.parametrize("behind", [0.05, 0.25])
def test_depth_of_what_lies_behind_glass_is_let_go(mug, seen, behind):
    observation, _, latent = seen
    belief = _doubting(len(latent), turn=np.deg2rad(1), shift=0.005, latent=0.1)
    estimator = RgbdEstimator(mug.category, _believing(mug, latent, belief))
    through = _patches(0.6, observation.depth.shape) & observation.mask
    depth = np.where(through, observation.depth + behind, observation.depth)
    clean, fused = estimator(observation), estimator(replace(observation, depth=depth))
    moved = np.linalg.norm(fused.camera_from_object[:3, 3] - observation.camera_from_object[:3, 3])
    assert moved < 0.003  # though three of five pixels say 5 cm and more
    assert _visible_error(mug, fused, seen) < _visible_error(mug, clean, seen) + 0.001


def test_depth_beyond_belief_changes_nothing(mug, seen):
    observation, _, latent = seen
    belief = _doubting(len(latent), turn=np.deg2rad(1), shift=0.005, latent=0.1)
    estimator = RgbdEstimator(mug.category, _believing(mug, latent, belief))
    fused = estimator(replace(observation, depth=np.where(observation.mask, observation.depth + 0.1, 0.0)))
    assert np.linalg.norm(fused.camera_from_object[:3, 3] - observation.camera_from_object[:3, 3]) < 5e-4
    assert fused.latent is not None
    assert fused.covariance is not None
    np.testing.assert_allclose(fused.latent, latent, atol=0.01)
    np.testing.assert_allclose(fused.covariance, belief, atol=0.05 * belief.max())


def test_the_same_depth_is_believed_where_the_picture_is_unsure(mug, seen):
    observation, pose, latent = seen
    depth = np.where(observation.mask, observation.depth + 0.03, 0.0)
    moved = {}
    for shift in (0.002, 0.02):
        belief = _doubting(len(latent), turn=1e-3, shift=shift, latent=0.01)
        estimator = RgbdEstimator(mug.category, _believing(mug, latent, belief))
        moved[shift] = estimator(replace(observation, depth=depth)).camera_from_object[2, 3] - pose[2, 3]
    assert moved[0.002] < 0.001
    assert moved[0.02] == pytest.approx(0.03, abs=0.003)


def test_what_it_says_of_its_doubt_holds(mug, seen):
    observation, _, latent = seen
    fused = RgbdEstimator(mug.category, _vague(mug, 1.0))(observation)
    assert fused.latent_covariance is not None
    deviations = np.sqrt(np.diag(fused.latent_covariance))
    # 1 were exact; the mean of 25 squares of one picture wanders, and few modes are seen at all.
    assert 0.3 < np.sqrt(np.mean(np.square((fused.latent - latent) / deviations))) < 2.0
    assert deviations.min() < 0.2


def test_sensed_depth_of_random_bottles_of_glass_helps_against_a_wrong_pose(renderer):
    category = gt.load_category("bottle")
    rgb = RgbEstimator(category, device="cpu")
    canonical = outer_surface(category.canonical, 3000)
    none = DeformationField.identity(category.shape_space.control_points)
    errors = {"rgb": [], "rgbd": []}
    for seed in (62_000_000, 62_000_001, 62_000_002):
        shape = objects.sample("bottle", seed)
        instance = Instance(category, str(seed), shape.scene(), none)
        noise = PoseNoise(0.02, np.deg2rad(5))
        sight = see_instance(instance, seed % 74, renderer=renderer, noise=noise)
        sensed = replace(sense(sight, GlassSettings(("bottle",)), 0), mask=None)
        truth = outer_surface(shape.mesh(), 1000)
        first = rgb(replace(sensed, depth=None))
        fused = RgbdEstimator(category, lambda _, first=first: first)(sensed)
        for name, estimate in (("rgb", first), ("rgbd", fused)):
            away = np.linalg.norm(estimate.camera_from_object[:3, 3] - sight.pose[:3, 3])
            errors[name].append((shape_error(truth, estimate.field(canonical)).E, away))
    by_picture, with_depth = (np.mean(errors[name], axis=0) for name in ("rgb", "rgbd"))
    assert with_depth[0] < by_picture[0]
    assert with_depth[1] < 0.5 * by_picture[1]


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


def test_depth_of_a_second_side_says_more_of_the_shape(mug, renderer):
    together, _ = observe_instance(mug, 40, renderer=renderer, pictures=2)
    true_latent = mug.category.shape_space.encode(mug.true_field.weights)
    estimator = RgbdEstimator(mug.category, _vague(mug, 1.0))
    one, both = (estimator(seen) for seen in (replace(together, further=()), together))
    errors = [np.linalg.norm(estimate.latent - true_latent) for estimate in (one, both)]
    assert errors[1] < errors[0]
    assert both.latent_covariance is not None
    assert one.latent_covariance is not None
    assert np.trace(both.latent_covariance) < np.trace(one.latent_covariance)
    # Poses that err each by itself do not say where the second camera stands.
    separate = estimator(replace(together, views="separate"))
    np.testing.assert_array_equal(separate.latent, one.latent)
