"""Joint refinement of pose and latent on motion whose truth is known."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import rotation_angle, transform_points
from grasptransfer.perception.picture_evidence import Motion, PictureEvidence
from grasptransfer.perception.pose_and_shape import fit_pose_and_shape
from grasptransfer.perception.pose_prior import PosePrior
from grasptransfer.poses import covariance_of
from grasptransfer.registration import DisplacementModel

CAMERA = Camera.from_fov(256, 192, np.deg2rad(40))


def _case(seed: int, modes: int = 4):
    """Points of a 10 cm ball, a smooth linear shape model, a pose and a latent."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    basis = np.stack([points @ rng.normal(0, 0.1, (3, 3)) for _ in range(modes)], axis=-1)
    mean = points @ rng.normal(0, 0.02, (3, 3))
    pose = look_at(0.5, rng.uniform(0, 6), rng.uniform(0, 1))
    return rng, points, DisplacementModel(mean, basis), pose, rng.normal(size=modes)


def _motion(points, model, pose, latent, scale=1.0):
    offsets = model.at(latent)
    pixels = CAMERA.project(transform_points(pose, points + offsets))
    return Motion(offsets, np.full(len(points), 1e-4 * scale), pixels, np.full(len(points), 0.05 * scale))


def _fit(motion, points, model, given_pose, pose_sigma=None):
    prior = PosePrior.of(given_pose, covariance_of(pose_sigma))
    return fit_pose_and_shape([PictureEvidence(motion, points, model, CAMERA)], [given_pose], [prior])


@given(st.integers(0, 1000))
@settings(max_examples=20)
@example(187)
def test_exact_motion_gives_the_true_pose_and_latent(seed):
    rng, points, model, pose, latent = _case(seed)
    given_pose = pose.copy()
    given_pose[:3, :3] = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix() @ given_pose[:3, :3]
    given_pose[:3, 3] += rng.uniform(-0.03, 0.03, 3)
    fit = _fit(_motion(points, model, pose, latent, scale=0.1), points, model, given_pose)
    assert fit.converged
    # The priors pull a little: ten independent cells leave about a millimetre of depth.
    assert np.linalg.norm(fit.camera_from_object[:3, 3] - pose[:3, 3]) < 2e-3
    assert rotation_angle(fit.camera_from_object[:3, :3] @ pose[:3, :3].T) < 0.01
    np.testing.assert_allclose(fit.latent, latent, atol=0.05)


def test_a_kept_pose_stays_exactly_as_given():
    _, points, model, pose, latent = _case(1)
    fit = _fit(_motion(points, model, pose, latent), points, model, pose, pose_sigma=0)
    np.testing.assert_array_equal(fit.camera_from_object, pose)
    assert (fit.covariance[:6] == 0).all()


def test_uncertain_motion_leaves_the_latent_at_the_prior():
    _, points, model, pose, latent = _case(2)
    fit = _fit(_motion(points, model, pose, latent, scale=1e6), points, model, pose)
    np.testing.assert_allclose(fit.latent, 0, atol=1e-3)
    np.testing.assert_allclose(np.diag(fit.covariance)[6:], 1, atol=1e-3)


def test_less_noise_means_a_tighter_posterior():
    _, points, model, pose, latent = _case(3)
    traces = [
        np.trace(
            _fit(_motion(points, model, pose, latent, scale=scale), points, model, pose).covariance[6:, 6:]
        )
        for scale in (1, 10, 100)
    ]
    assert traces[0] < traces[1] < traces[2]


@pytest.mark.parametrize("along", [-0.03, 0.03])
def test_the_distance_may_move_as_far_as_the_place_across_the_ray_was_wrong(along):
    _, points, model, pose, latent = _case(4)
    left = []
    for across in (0.0, 0.04):
        given_pose = pose.copy()
        given_pose[:3, 3] += [across, 0, along]
        fit = _fit(_motion(points, model, pose, latent, scale=3.0), points, model, given_pose)
        left.append(abs(fit.camera_from_object[2, 3] - pose[2, 3]))
    assert left[1] < 0.8 * left[0]


def test_a_picture_that_says_nothing_leaves_the_pose_as_unsure_as_it_was_given():
    _, points, model, pose, latent = _case(5)
    fit = _fit(_motion(points, model, pose, latent, scale=1e6), points, model, pose, (0.01, 2.0))
    covariance = covariance_of((0.01, 2.0))
    assert covariance is not None
    given = np.sqrt(np.diag(covariance)) * np.sqrt(5 / 11)  # At the centre of Student's distribution.
    found = np.sqrt(np.diag(fit.covariance)[:6])
    np.testing.assert_allclose(found, given, rtol=0.02)
