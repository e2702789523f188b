"""Confidence: chances that hold, fitted to a trained network and kept in its weight file."""

import numpy as np
import pytest
import torch

from grasptransfer.category import load_category
from grasptransfer.perception.confidence import Confidence, evidence
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.networks.ensemble import Ensemble
from grasptransfer.perception.weights import WeightsInfo, load_weights, save_weights, trained_on
from grasptransfer.workshop.training.confidence_fit import (
    Seen,
    fit_confidence,
    fit_overconfidence,
    fit_score,
)


def _seen(own, match, overlap, far):
    return Seen(own, evidence(match, overlap, np.full(4, far)))


def test_the_score_tells_own_objects_from_strangers():
    rng = np.random.default_rng(0)
    own = [_seen(True, rng.uniform(0.6, 1), rng.uniform(0.7, 0.95), rng.uniform(0.2, 0.8)) for _ in range(50)]
    strangers = [
        _seen(False, rng.uniform(0, 0.6), rng.uniform(0.4, 0.8), rng.uniform(0.5, 1.2)) for _ in range(30)
    ]
    fitted = fit_score(own + strangers)
    accepted = [fitted.of_the_category(one.evidence) > 0.5 for one in own]
    taken_in = [fitted.of_the_category(one.evidence) > 0.5 for one in strangers]
    assert np.mean(accepted) > 0.9
    assert np.mean(taken_in) < 0.1
    assert fitted.match > 0 > fitted.far


def test_strangers_that_look_like_own_objects_get_an_even_chance():
    rng = np.random.default_rng(0)
    seen = [_seen(own, *rng.uniform(0.3, 0.9, 3)) for own in (True, False) for _ in range(400 if own else 40)]
    chances = [fit_score(seen).of_the_category(one.evidence) for one in seen]
    assert np.mean(chances) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("deviation", [0.5, 1.0, 3.0])
def test_widened_intervals_hold_the_truth_as_often_as_stated(deviation):
    rng = np.random.default_rng(1)
    seen = [Seen(True, np.zeros(3), rng.normal(0, deviation, 20)) for _ in range(200)]
    factor = fit_overconfidence(seen)
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
    assert info.confidence == Confidence()
    done = []
    confidence = fit_confidence(path, [mug], pictures=2, progress=lambda *state: done.append(state))
    after, info = load_weights(path)
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert info.confidence.as_data() == confidence.as_data()
    assert info.confidence != Confidence()
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
