"""Confidence: chances that hold, fitted to a trained network and kept in its weight file."""

import numpy as np
import pytest
import torch

from grasptransfer.category import load_category
from grasptransfer.perception.confidence import WRONG, Confidence
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.networks.ensemble import Ensemble
from grasptransfer.perception.signs import OF_PASS, SIGNS
from grasptransfer.perception.weights import WeightsInfo, load_weights, save_weights, trained_on
from grasptransfer.workshop.training.confidence_fit import fit_confidence, fit_overconfidence
from grasptransfer.workshop.training.verdict_fit import Seen, fit_verdicts


def _seen(verdict, rng, *, group=0, name="box"):
    """Signs around 0 of right inputs; each wrong kind differs from them in a sign of its own."""
    signs = rng.normal(size=len(SIGNS))
    if verdict in WRONG:
        signs[3 * WRONG.index(verdict)] += 6
    return Seen(group, name, verdict, signs)


def test_verdicts_tell_right_inputs_from_each_kind_of_wrong_ones():
    rng = np.random.default_rng(0)
    verdicts = [EstimateStatus.OK] * 200 + [each for each in WRONG for _ in range(40)]
    seen = [_seen(verdict, rng) for verdict in verdicts]
    confidence = Confidence(fit_verdicts(seen)[0])
    judged = [confidence.judge(_seen(verdict, rng).signs, settled=True) for verdict in verdicts]
    assert np.mean([status is verdict for (status, _), verdict in zip(judged, verdicts, strict=True)]) > 0.9
    assert confidence.judge(seen[0].signs, settled=False)[0] is EstimateStatus.NOT_CONVERGED
    np.testing.assert_allclose(confidence.chances(seen[0].signs).sum(), 1)


def test_wrong_inputs_that_look_like_right_ones_get_an_even_chance():
    rng = np.random.default_rng(0)
    verdicts = [EstimateStatus.OK] * 400 + [WRONG[0]] * 40
    seen = [Seen(0, "box", verdict, rng.normal(size=len(SIGNS))) for verdict in verdicts]
    confidence = Confidence(fit_verdicts(seen)[0])
    assert np.mean([confidence.chances(one.signs)[0] for one in seen]) == pytest.approx(0.5, abs=0.1)


def test_of_two_poses_for_a_picture_the_right_one_is_preferred():
    rng = np.random.default_rng(0)
    seen = []
    for group in range(100):
        picture = rng.normal(0, 10, len(SIGNS))  # what the picture itself changes says nothing of the pose
        for verdict, shift in ((EstimateStatus.OK, 1.5), (EstimateStatus.POSE_TURNED, 0.0)):
            signs = picture + rng.normal(size=len(SIGNS))
            signs[:2] += shift
            seen.append(Seen(group, "box", verdict, signs))
    _, of_pass, of_pose = fit_verdicts(seen)
    confidence = Confidence(of_pass=of_pass, of_pose=of_pose)
    for length in (len(OF_PASS), len(SIGNS)):
        right = [confidence.preference(one.signs[:length]) for one in seen[::2]]
        turned = [confidence.preference(one.signs[:length]) for one in seen[1::2]]
        assert np.mean(np.array(right) > turned) > 0.8


@pytest.mark.parametrize("deviation", [0.5, 1.0, 3.0])
def test_widened_intervals_hold_the_truth_as_often_as_stated(deviation):
    rng = np.random.default_rng(1)
    factor = fit_overconfidence([rng.normal(0, deviation, 20) for _ in range(200)])
    assert factor == pytest.approx(max(deviation, 1.0) ** 2, rel=0.1)
    covariance = Confidence(overconfidence=factor).widened(0.01 * np.eye(3))
    np.testing.assert_allclose(covariance, 0.01 * factor * np.eye(3), atol=1e-12)


def test_nothing_is_less_sure_than_the_shape_space():
    widened = Confidence(overconfidence=4.0).widened(np.diag([0.9, 0.1]))
    np.testing.assert_allclose(widened, np.diag([1.0, 0.4]))


def test_fitting_keeps_the_network_and_writes_the_confidence_beside_it(tmp_path):
    torch.manual_seed(0)
    path = tmp_path / "mug.safetensors"
    mug = load_category("mug")
    save_weights(
        path,
        Ensemble([build_network("compact", width=0.1)]),
        WeightsInfo("compact", {"mug": trained_on(mug)}, width=0.1),
    )
    before, info = load_weights(path)
    assert info.confidence.as_data() == Confidence().as_data()
    done = []
    confidence = fit_confidence(path, [mug], pictures=1, progress=lambda *state: done.append(state))
    after, info = load_weights(path)
    assert done == [(1, 2), (2, 2)]
    assert info.confidence.as_data() == confidence.as_data()
    assert info.confidence.as_data() != Confidence().as_data()
    for name, tensor in before.state_dict().items():
        assert torch.equal(tensor, after.state_dict()[name])


def test_widening_the_joint_keeps_how_the_pose_goes_with_the_latent():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(9, 9)) * np.array([0.02] * 3 + [0.01] * 3 + [0.2] * 3)[:, None]
    joint, confidence = root @ root.T, Confidence(overconfidence=3.0)
    widened = confidence.widened_with_pose(joint)
    np.testing.assert_allclose(widened[6:, 6:], confidence.widened(joint[6:, 6:]))
    slope = np.linalg.solve(joint[6:, 6:], joint[6:, :6])
    np.testing.assert_allclose(np.linalg.solve(widened[6:, 6:], widened[6:, :6]), slope)
    # What the pose leaves open when the latent is known is as before; all in all it is wider.
    left = widened[:6, :6] - widened[:6, 6:] @ slope
    np.testing.assert_allclose(left, joint[:6, :6] - joint[:6, 6:] @ slope, atol=1e-12)
    assert np.linalg.eigvalsh(widened - joint).min() > -1e-12


def test_a_pose_that_was_kept_stays_certain_when_widened():
    joint = np.zeros((9, 9))
    joint[6:, 6:] = np.diag([0.1, 0.2, 0.3])
    widened = Confidence(overconfidence=2.0).widened_with_pose(joint)
    np.testing.assert_array_equal(widened[:6], 0)
