"""The shipped network on pictures of instances that no training saw."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import PoseError, WeightsError
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.workshop.benchmark.errors_of_shape import outer_surface, shape_error
from grasptransfer.workshop.benchmark.seen_instances import instances, observe_instance


@pytest.fixture(scope="module")
def renderer():
    with Renderer() as made:
        yield made


@pytest.fixture(scope="module")
def estimator():
    return RgbEstimator(gt.load_category("mug"), refine_pose=False, device="cpu")


@pytest.fixture(scope="module")
def seen(renderer):
    """A picture of a mug, without depth and mask."""
    instance = next(iter(instances(["mug"], None)))
    observation, _ = observe_instance(instance, 30, renderer=renderer)
    return replace(observation, depth=None, mask=None)


@pytest.mark.parametrize("category", gt.list_categories())
def test_reconstruction_and_mask_meet_unseen_instances(category, renderer):
    estimator = RgbEstimator(gt.load_category(category), refine_pose=False, device="cpu")
    canonical = outer_surface(estimator.category.canonical, 2000)
    rgb, rigid, ious = [], [], []
    for instance in list(instances([category], None))[:4]:
        truth = outer_surface(instance.solid, 1000)
        observation, _ = observe_instance(instance, 30, renderer=renderer)
        estimate = estimator(replace(observation, depth=None, mask=None))
        rgb.append(shape_error(truth, estimate.field(canonical)).E)
        rigid.append(shape_error(truth, canonical).E)
        ious.append((estimate.mask & observation.mask).sum() / (estimate.mask | observation.mask).sum())
    assert np.mean(rgb) < 0.6 * np.mean(rigid)
    assert np.mean(ious) > 0.75


def test_a_picture_gives_the_same_estimate_every_time(estimator, seen):
    first, second = estimator(seen), estimator(seen)
    np.testing.assert_array_equal(first.latent, second.latent)


def test_no_box_is_needed(estimator, seen):
    estimate = estimator(replace(seen, box=None))
    assert estimate.status is not EstimateStatus.OUT_OF_CATEGORY


def test_a_told_mask_is_what_the_outline_meets(renderer):
    instance = next(iter(instances(["mug"], None)))
    told, _ = observe_instance(instance, 30, renderer=renderer)
    estimator = RgbEstimator(gt.load_category("mug"), refine_pose=False, device="cpu")
    estimate = estimator(replace(told, depth=None))
    both, either = (estimate.mask & told.mask).sum(), (estimate.mask | told.mask).sum()
    assert both / either > 0.985
    wide = estimator(replace(told, mask=binary_dilation(told.mask, iterations=10), depth=None))
    vertices = estimator.category.canonical.vertices
    sizes = [np.ptp(each.field(vertices), axis=0).prod() for each in (estimate, wide)]
    assert sizes[1] > 1.05 * sizes[0]


def test_the_posterior_is_a_covariance_narrower_than_the_prior(estimator, seen):
    covariance = estimator(seen).latent_covariance
    values = np.linalg.eigvalsh(covariance)
    assert values.min() > 0
    assert values.max() <= 1 + 1e-9


def test_a_pose_far_beside_the_told_box_is_found_again(seen):
    estimator = RgbEstimator(gt.load_category("mug"), device="cpu")
    told = seen.camera_from_object.copy()
    told[0, 3] += 0.04
    estimate = estimator(replace(seen, camera_from_object=told))
    error = np.linalg.norm((estimate.camera_from_object - seen.camera_from_object)[:2, 3])
    assert error < 0.01


def test_another_object_is_refused(estimator, renderer):
    drill = next(iter(instances(["drill"], None)))
    observation, _ = observe_instance(drill, 30, renderer=renderer)
    estimate = estimator(replace(observation, depth=None, mask=None))
    assert estimate.status is EstimateStatus.OUT_OF_CATEGORY


@pytest.mark.parametrize("distance", [-1.0, 0.04])
def test_a_model_behind_the_camera_or_around_it_is_refused(estimator, seen, distance):
    pose = seen.camera_from_object.copy()
    pose[:3, 3] = [0, 0, distance]
    with pytest.raises(PoseError, match="nearest point"):
        estimator(replace(seen, camera_from_object=pose))


def test_weights_of_another_canonical_model_or_shape_space_are_refused(tmp_path):
    from grasptransfer.perception.networks import build_network
    from grasptransfer.perception.networks.ensemble import Ensemble
    from grasptransfer.perception.weights import WeightsInfo, save_weights, trained_on

    path, mug = tmp_path / "other.safetensors", gt.load_category("mug")
    for changed, problem in (
        ("canonical.glb", "another canonical"),
        ("shape_space.npz", "another shape space"),
    ):
        info = WeightsInfo("compact", {"mug": trained_on(mug) | {changed: "another"}}, width=0.1)
        save_weights(path, Ensemble([build_network("compact", width=0.1)]), info)
        with pytest.raises(WeightsError, match=problem):
            RgbEstimator(mug, weights=path, device="cpu")
