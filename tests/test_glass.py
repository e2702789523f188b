"""`bench glass`: what is told to whom."""

from dataclasses import replace

import numpy as np
import pytest

from grasptransfer.perception.baselines import RigidEstimator
from grasptransfer.workshop.benchmark import glass
from grasptransfer.workshop.benchmark.glass import GlassSettings, measure_glass, summarise_glass

SETTINGS = GlassSettings(("bottle",), views=1, methods=("rigid",))


class _Listening:
    """Stands for the set of estimators: keeps what each is told, answers as `rigid` does."""

    told: dict
    refined: bool

    def __init__(self, *_, refine_pose, **__):
        type(self).refined = refine_pose

    def of(self, instance, methods):
        type(self).told = {method: [] for method in methods}

        def listen(method):
            def estimate(observation):
                self.told[method].append(observation)
                return RigidEstimator(instance.category)(observation)

            return estimate

        return {method: listen(method) for method in methods}


@pytest.fixture(scope="module")
def told():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(glass, "EstimatorSet", _Listening)
        measure_glass(replace(SETTINGS, methods=("rgb", "rgbd", "cls")), "bottle", "bottle_0012")
    return _Listening.told


def test_rgbd_has_to_tell_the_object_and_its_surface_by_itself(told):
    exact, sensed = told["rgbd"]
    assert exact.mask is None
    assert sensed.mask is None
    assert exact.box is not None
    # The wall behind is in the depth it is given, all around the object.
    assert (sensed.depth > 0).sum() > 2 * (exact.depth > 0).sum()


def test_cls_is_given_the_mask_and_no_depth_far_from_the_object(told):
    exact, sensed = told["cls"]
    assert exact.mask is not None
    assert sensed.mask is not None
    reach = np.abs(sensed.depth[sensed.depth > 0] - exact.camera_from_object[2, 3]).max()
    assert reach < told["rgbd"][1].depth.max() - exact.camera_from_object[2, 3]


def test_a_wrong_told_pose_shows_where_the_shape_is_placed():
    noisy = replace(SETTINGS, translation_noise=0.02, rotation_noise=np.deg2rad(5))
    summary = summarise_glass([measure_glass(noisy, "bottle", "bottle_0012")])
    assert summary["E_rigid_placed_mean"] != pytest.approx(summary["E_rigid_mean"], rel=0.05)


def test_only_a_wrong_told_pose_is_refined(told):
    assert not _Listening.refined
    assert told["rgb"]
