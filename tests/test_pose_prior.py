"""How sure a given pose is: input, effect, and what is reported of it."""

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import GraspTransferError
from grasptransfer.perception.observation import observe
from grasptransfer.perception.pose_prior import PoseDeviation, PosePrior

POSE = look_at(0.8, 0.4, 0.6)
PICTURE = np.full((120, 160, 3), 90, np.uint8)
CAMERA = gt.Camera.from_fov(160, 120, 1.0)


def test_real_estimators_err_most_along_the_ray_and_in_proportion_to_the_distance():
    near, far = (PosePrior.of(look_at(distance, 0.4, 0.6), None) for distance in (0.5, 1.0))
    assert near is not None
    assert far is not None
    assert near.deviation.along_ray > 2 * near.deviation.across_ray
    assert far.deviation.along_ray == pytest.approx(2 * near.deviation.along_ray)
    assert far.deviation.turn == pytest.approx(near.deviation.turn)


def test_an_exact_pose_has_no_prior():
    assert PosePrior.of(POSE, np.zeros((6, 6))) is None


def test_a_pose_that_is_sure_in_some_directions_alone_has_a_finite_hold():
    covariance = np.zeros((6, 6))
    covariance[5, 5] = 0.01**2
    prior = PosePrior.of(POSE, covariance)
    assert prior is not None
    hold, pull = prior.quadratic(POSE)
    assert np.isfinite(hold).all()
    np.testing.assert_allclose(pull, 0, atol=1e-9)
    assert hold[0, 0] > 1e3 * hold[5, 5]


def test_a_pose_far_off_is_held_less():
    prior = PosePrior.of(POSE, None)
    assert prior is not None
    moved = POSE.copy()
    moved[:3, 3] += 0.1
    assert np.trace(prior.quadratic(moved)[0]) < 0.5 * np.trace(prior.quadratic(POSE)[0])


def test_deviations_are_those_along_and_across_the_ray():
    covariance = np.diag([np.deg2rad(2.0) ** 2] * 3 + [0.003**2, 0.003**2, 0.02**2])
    straight_ahead = np.eye(4)
    straight_ahead[2, 3] = 1.0
    deviation = PoseDeviation.of(straight_ahead, covariance)
    assert (deviation.along_ray, deviation.across_ray) == pytest.approx((0.02, 0.003))
    assert deviation.turn == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("sigma", "variances"),
    [(0, np.zeros(6)), ((0.01, 2.0), [np.deg2rad(2) ** 2] * 3 + [1e-4] * 3)],
)
def test_an_observation_holds_the_covariance_of_its_pose(sigma, variances):
    seen = observe(PICTURE, POSE, camera=CAMERA, pose_sigma=sigma)
    assert seen.pose_covariance is not None
    np.testing.assert_allclose(np.diag(seen.pose_covariance), variances)


@pytest.mark.parametrize("sigma", [-1, (-0.01, 2), (0.01, 2, 3), (10, 2), np.diag([-1.0] * 6), "exact"])
def test_what_is_no_uncertainty_is_refused_by_its_name(sigma):
    with pytest.raises(GraspTransferError, match="pose_sigma"):
        observe(PICTURE, POSE, camera=CAMERA, pose_sigma=sigma)


def test_a_box_goes_beside_a_mask_and_is_refused_by_its_name():
    mask = np.zeros((120, 160), bool)
    mask[40:60, 60:90] = True
    seen = observe(PICTURE, POSE, camera=CAMERA, mask=mask, box=(50, 30, 100, 80))
    assert seen.box == (50, 30, 100, 80)
    assert seen.mask is not None
    with pytest.raises(GraspTransferError, match="box"):
        observe(PICTURE, POSE, camera=CAMERA, box=(5, 6, 7))
