"""The shipped network on pictures of mugs that no training saw."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.benchmark.errors_of_shape import outer_surface, shape_error
from grasptransfer.benchmark.seen_instances import instances, observe_instance
from grasptransfer.errors import PoseError, WeightsError
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.rgb import RgbEstimator


@pytest.fixture(scope="module")
def renderer():
    with Renderer() as made:
        yield made


@pytest.fixture(scope="module")
def estimator(renderer):
    return RgbEstimator(gt.load_category("mug"), renderer=renderer, refine_pose=False, device="cpu")


@pytest.fixture(scope="module")
def seen(renderer):
    """Four instances from one side each: observation without depth and mask, and true surface."""
    found = []
    for instance in list(instances(["mug"], None))[:4]:
        observation, _ = observe_instance(instance, 30, views=74, renderer=renderer)
        found.append(
            (
                replace(observation, depth=None, mask=None),
                observation.mask,
                outer_surface(instance.solid, 1500),
            )
        )
    return found


def test_the_reconstruction_is_nearer_to_unseen_mugs_than_the_canonical_model(estimator, seen):
    canonical = outer_surface(estimator.category.canonical, 3000)
    rgb = [shape_error(truth, estimator(o).field(canonical)).E for o, _, truth in seen]
    rigid = [shape_error(truth, canonical).E for _, _, truth in seen]
    assert np.mean(rgb) < 0.6 * np.mean(rigid)


def test_the_predicted_mask_covers_the_object(estimator, seen):
    for observation, mask, _ in seen:
        predicted = estimator(observation).mask
        assert predicted.shape == mask.shape
        assert (predicted & mask).sum() / (predicted | mask).sum() > 0.75


def test_a_picture_gives_the_same_estimate_every_time(estimator, seen):
    first, second = estimator(seen[0][0]), estimator(seen[0][0])
    np.testing.assert_array_equal(first.latent, second.latent)


def test_no_box_is_needed(estimator, seen):
    estimate = estimator(replace(seen[0][0], box=None))
    assert estimate.status is not EstimateStatus.OUT_OF_CATEGORY


def test_the_posterior_is_a_covariance_narrower_than_the_prior(estimator, seen):
    covariance = estimator(seen[0][0]).latent_covariance
    values = np.linalg.eigvalsh(covariance)
    assert values.min() > 0
    assert values.max() <= 1 + 1e-9


def test_a_pose_behind_the_camera_is_refused(estimator, seen):
    observation = seen[0][0]
    pose = observation.camera_from_object.copy()
    pose[:3, 3] = [0, 0, -1.0]
    with pytest.raises(PoseError):
        estimator(replace(observation, camera_from_object=pose))


def test_weights_of_another_canonical_model_are_refused(tmp_path, renderer):
    from grasptransfer.perception.networks import build_network
    from grasptransfer.perception.weights import WeightsInfo, save_weights

    path = tmp_path / "other.safetensors"
    save_weights(path, build_network("compact"), WeightsInfo("compact", {"mug": "another"}))
    with pytest.raises(WeightsError, match="another canonical"):
        RgbEstimator(gt.load_category("mug"), renderer=renderer, weights=path, device="cpu")
