"""The estimators to compare with say how sure they are, and when they did not settle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import ImageError
from grasptransfer.frames import rigid
from grasptransfer.perception.baselines import ClsEstimator, CpdEstimator, SimilarityEstimator
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.workshop.benchmark.seen_instances import load_instance, observe_instance


@pytest.fixture(scope="module")
def mug():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def seen():
    with Renderer() as renderer:
        return observe_instance(load_instance("mug", "mug_0014"), 40, renderer=renderer)[0]


def test_cls_doubts_the_pose_that_it_refines_and_no_other(mug, seen):
    kept = ClsEstimator(mug, refine_pose=False)(seen).covariance
    refined = ClsEstimator(mug, refine_pose=True)(seen).covariance
    assert kept is not None
    assert refined is not None
    assert (kept[:6] == 0).all()
    deviations = np.sqrt(np.diag(refined)[:6])
    assert ((deviations > 1e-5) & (deviations < 0.2)).all()
    assert np.linalg.eigvalsh(refined).min() > 0


def test_cls_keeps_a_pose_that_is_said_to_be_exact(mug, seen):
    exact = replace(seen, pose_covariance=np.zeros((6, 6)))
    estimate = ClsEstimator(mug, refine_pose=True)(exact)
    np.testing.assert_allclose(estimate.camera_from_object, seen.camera_from_object, atol=1e-12)


def test_cls_states_the_pose_s_doubt_along_the_camera_s_axes(mug, seen):
    """A camera turned about its own axis sees the same; its doubt turns with it."""
    turn = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()
    turned = replace(
        seen,
        camera_from_object=rigid(turn, np.zeros(3)) @ seen.camera_from_object,
        depth=None,
    )
    cloud_of = ClsEstimator(mug, refine_pose=True)
    with pytest.MonkeyPatch.context() as patch:
        from grasptransfer.perception import baselines

        cloud = baselines.depth_cloud(seen)
        patch.setattr(baselines, "depth_cloud", lambda _: cloud)
        first, second = cloud_of(seen).covariance, cloud_of(turned).covariance
    assert first is not None
    assert second is not None
    whole = np.eye(len(first))
    whole[:3, :3] = whole[3:6, 3:6] = turn
    np.testing.assert_allclose(second, whole @ first @ whole.T, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("kind", [ClsEstimator, CpdEstimator])
def test_a_box_does_not_serve_where_depth_is_cut_out_by_a_mask(kind, mug, seen):
    with pytest.raises(ImageError, match="a box also holds depth"):
        kind(mug)(replace(seen, mask=None))


def test_cpd_that_stops_at_its_limit_says_so(mug, seen, monkeypatch):
    from grasptransfer.perception import baselines

    def hurried(*clouds, **options):
        return cpd(*clouds, **options, max_iterations=2)

    cpd = baselines.cpd
    monkeypatch.setattr(baselines, "cpd", hurried)
    assert CpdEstimator(mug)(seen).status is EstimateStatus.NOT_CONVERGED


def test_a_size_at_the_bound_is_none(mug, seen):
    estimator = SimilarityEstimator(mug)
    assert estimator(seen).status is EstimateStatus.OK
    u0, v0, _, _ = seen.box
    assert estimator(replace(seen, box=(u0, v0, u0 + 2, v0 + 2))).status is EstimateStatus.NOT_CONVERGED
