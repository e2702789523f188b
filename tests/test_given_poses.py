"""Which poses benchmarks give, and what they say of them."""

import numpy as np
import pytest

from grasptransfer.drawing.views import look_at
from grasptransfer.errors import GraspTransferError
from grasptransfer.frames import drift
from grasptransfer.perception.pose_prior import PosePrior
from grasptransfer.workshop.benchmark.given_poses import REGIMES, GivenPoses

POSE = look_at(0.8, 0.4, 0.6)


def test_exact_poses_are_said_to_be_exact_wide_ones_wide_and_nothing_is_said_of_an_estimators():
    said = [GivenPoses.of(told).pose_sigma for told in REGIMES]
    assert said == [0, None, (0.03, 5.0)]
    assert GivenPoses.of("wide", ("unsaid",)).pose_sigma is None
    assert GivenPoses.of("exact", ("unsaid",)).pose_sigma is None
    assert GivenPoses.of("wide", ("0.02", "5")).pose_sigma == (0.02, 5)


def test_the_exact_pose_is_given_as_it_is():
    np.testing.assert_array_equal(GivenPoses.of("exact").apply(POSE, np.random.default_rng(0)), POSE)


def test_half_of_the_errors_lie_where_the_prior_expects_them():
    rng, prior = np.random.default_rng(1), PosePrior.of(POSE, None)
    assert prior is not None
    errors = np.array([drift(POSE, GivenPoses.of("estimator").apply(POSE, rng)) for _ in range(400)])
    ray = POSE[:3, 3] / np.linalg.norm(POSE[:3, 3])
    # Student's distribution with five degrees of freedom: the median error is 0.73 deviations.
    assert np.median(np.abs(errors[:, 3:] @ ray)) == pytest.approx(0.73 * prior.deviation.along_ray, rel=0.2)


@pytest.mark.parametrize(("told", "said"), [("exactly", ()), ("exact", ("sure",)), ("exact", ("0.1",))])
def test_what_is_unknown_is_refused(told, said):
    with pytest.raises(GraspTransferError):
        GivenPoses.of(told, said)


def test_a_set_on_file_goes_by_its_name():
    assert GivenPoses.of("mine", names=("mine",)).told == "mine"
