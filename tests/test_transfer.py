"""The main flow on pictures whose truth is known."""

import numpy as np
import pytest
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.errors import CategoryError, GripperError, NotSucceeded, SettingsError
from grasptransfer.frames import rigid, rotation_angle
from grasptransfer.perception.baselines import depth_cloud
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.observation import observe
from grasptransfer.registration import DeformationField


@pytest.fixture(scope="module")
def category():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def picture(category):
    image, seen = see_mug(category)
    return image, seen.mask, seen.depth


@pytest.fixture(scope="module")
def true_flow(category):
    field = category.field(category.test[1])
    return gt.GraspTransfer(category, estimator=lambda seen: ShapeEstimate(field, seen.camera_from_object))


def test_the_true_shape_gives_usable_grasps_of_every_kind(true_flow, picture):
    result = true_flow.transfer(picture[0], POSE, camera=CAMERA)
    assert {"rim", "handle"} <= {grasp.label for grasp in result.usable}
    assert result.status is EstimateStatus.OK


def test_grasps_come_best_first_and_failed_ones_last(true_flow, picture):
    result = true_flow.transfer(picture[0], POSE, camera=CAMERA)
    usable = [grasp.usable for grasp in result.grasps]
    assert usable == sorted(usable, reverse=True)
    scores = [grasp.score for grasp in result.usable]
    assert scores == sorted(scores, reverse=True)
    assert all(grasp.reason for grasp in result.grasps)


def test_every_pose_is_rigid_and_its_frames_meet(true_flow, picture):
    for grasp in true_flow.transfer(picture[0], POSE, camera=CAMERA).grasps:
        np.testing.assert_allclose(grasp.camera_from_gripper, POSE @ grasp.object_from_gripper, atol=1e-12)
        rotation = grasp.object_from_gripper[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) > 0
        # A mug's grasps turn with its surface, not upside down.
        assert rotation_angle(rotation @ grasp.canonical_from_gripper[:3, :3].T) < np.deg2rad(60)


def test_no_deformation_leaves_the_reconstruction_canonical(category, picture):
    result = gt.transfer_grasps(picture[0], POSE, "mug", camera=CAMERA, estimator="rigid")
    np.testing.assert_allclose(result.mesh.vertices, category.canonical.vertices, atol=1e-9)


def test_similarity_scales_towards_the_seen_box(category, picture):
    result = gt.transfer_grasps(
        picture[0], POSE, "mug", camera=CAMERA, mask=picture[1], estimator="similarity"
    )
    ratio = result.mesh.extents / category.canonical.extents
    np.testing.assert_allclose(ratio, ratio[0], rtol=0.01)


@pytest.mark.parametrize("estimator", ["cls", "cpd"])
def test_depth_estimators_bring_the_model_to_what_was_measured(category, picture, estimator):
    from scipy.spatial import KDTree

    image, mask, depth = picture
    result = gt.transfer_grasps(
        image, POSE, "mug", camera=CAMERA, mask=mask, depth=depth, estimator=estimator, refine_pose=False
    )
    # Only the seen side: CPD, which knows no category, may ruin the hidden one.
    measured = depth_cloud(observe(image, POSE, camera=CAMERA, mask=mask, depth=depth))
    before = KDTree(category.canonical.vertices).query(measured)[0].mean()
    after = KDTree(result.mesh.vertices).query(measured)[0].mean()
    assert after < 0.7 * before


def test_the_field_of_a_pair_takes_points_of_a_to_b(category, picture, true_flow):
    a = true_flow.transfer(picture[0], POSE, camera=CAMERA)
    other = category.field(category.test[0])
    b = gt.GraspTransfer(
        category, estimator=lambda seen: ShapeEstimate(other, seen.camera_from_object)
    ).transfer(picture[0], POSE, camera=CAMERA)
    canonical = np.asarray(category.canonical.vertices)[::97]
    between = gt.register_pair(a, b)
    # The inverse is iterative: a tenth of a millimetre is far below what matters to a grasp.
    np.testing.assert_allclose(between(a.field(canonical)), b.field(canonical), atol=1e-4)


def test_a_support_plane_blocks_grasps_from_below(true_flow, picture):
    # The plane passes through the object's middle, so low grasps end in it.
    up = POSE[:3, :3] @ [0, 0, 1.0]
    scene = gt.Scene(support_plane=(POSE[:3, 3] + 0.03 * up, up))
    free = true_flow.transfer(picture[0], POSE, camera=CAMERA)
    blocked = true_flow.transfer(picture[0], POSE, camera=CAMERA, scene=scene)
    assert len(blocked.usable) < len(free.usable)
    assert any("support" in grasp.reason for grasp in blocked.grasps)


def test_strict_raises_where_nothing_is_usable(category, picture, true_flow):
    up = POSE[:3, :3] @ [0, 0, 1.0]
    scene = gt.Scene(support_plane=(POSE[:3, 3] + 0.3 * up, up))
    with pytest.raises(NotSucceeded, match="no usable grasp"):
        true_flow.transfer(picture[0], POSE, camera=CAMERA, scene=scene, strict=True)


@pytest.mark.parametrize(
    ("arguments", "error", "word"),
    [
        ({"category": "teapot"}, CategoryError, "mug"),
        ({"gripper": "claw"}, GripperError, "panda"),
        ({"estimator": "magic"}, SettingsError, "similarity"),
    ],
)
def test_an_unknown_name_lists_the_known_ones(picture, arguments, error, word):
    settings = {"category": "mug", "camera": CAMERA, "estimator": "rigid"} | arguments
    with pytest.raises(error, match=word):
        gt.transfer_grasps(picture[0], POSE, **settings)


def test_a_negative_seed_is_refused(picture):
    with pytest.raises(SettingsError, match="seed"):
        gt.transfer_grasps(picture[0], POSE, "mug", camera=CAMERA, estimator="rigid", seed=-1)


def test_a_gpu_that_is_not_there_is_refused_with_what_is(picture, monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(SettingsError, match=r"not in this machine .*known: auto, cpu\b"):
        gt.transfer_grasps(picture[0], POSE, "mug", camera=CAMERA, device="cuda")


def test_a_moved_camera_moves_the_grasps_with_it(true_flow, picture):
    moved = rigid(np.eye(3), np.array([0.01, 0.0, 0.05])) @ POSE
    here = true_flow.transfer(picture[0], POSE, camera=CAMERA).grasps[0]
    there = true_flow.transfer(picture[0], moved, camera=CAMERA).grasps[0]
    np.testing.assert_allclose(here.object_from_gripper, there.object_from_gripper, atol=1e-9)


def test_a_picture_without_the_category_gives_no_usable_grasp(picture):
    flow = gt.GraspTransfer("mug")
    seen, black = (flow.transfer(image, POSE, camera=CAMERA) for image in (picture[0], 0 * picture[0]))
    assert seen.usable
    assert black.status is EstimateStatus.NOTHING_SEEN
    assert not black.usable
    assert any("hardly shows" in grasp.reason for grasp in black.grasps)


def test_a_scene_may_be_a_file_and_nothing_else(true_flow, picture, tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("support_plane: {point: [0, 0, 2], normal: [0, 0, -1]}\n")
    assert true_flow.transfer(picture[0], POSE, camera=CAMERA, scene=path).scene.support_plane is not None
    with pytest.raises(gt.GraspTransferError, match=r"scene.*dict"):
        true_flow.transfer(picture[0], POSE, camera=CAMERA, scene={})


def test_a_told_category_is_trusted_beyond_what_the_picture_alone_says():
    field = DeformationField.identity(np.eye(3))
    trust = [ShapeEstimate(field, POSE, category_score=score).trust for score in (None, 0.0, 0.1, 0.5, 1.0)]
    np.testing.assert_allclose(trust, [1, 0, 19 * 0.1 / (19 * 0.1 + 0.9), 0.95, 1])
