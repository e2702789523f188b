"""Poses proposed from picture and box alone."""

import numpy as np
import pytest
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import ImageError, WeightsError
from grasptransfer.frames import rigid, rotation_angle
from grasptransfer.perception.pose_search import chances, finder, grid
from grasptransfer.perception.pose_search.traits import POSE_TRAITS, VIEW_TRAITS
from grasptransfer.workshop.benchmark.pose_errors import pose_error, symmetry_turns

BOUNDS = np.array([[-0.05, -0.04, -0.03], [0.05, 0.04, 0.03]])


@pytest.fixture(scope="module")
def mug():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def seen(mug):
    picture, rendering = see_mug(mug)
    v, u = np.nonzero(rendering.mask)
    return picture, (float(u.min()), float(v.min()), float(u.max()), float(v.max()))


@pytest.fixture(scope="module")
def few_views():
    """Three views, one of which is 9 degrees from the true one, and two of them fitted."""
    near = [look_at(1.0, 0.6 + turn, 0.7)[:3, :3] for turn in (0.15, 2.2, 4.2)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finder, "view_rotations", lambda: np.stack(near))
        patch.setattr(finder, "FEWEST_VIEWS", 3)
        patch.setattr(finder, "MOST_FITTED", 2)
        yield


@pytest.fixture(scope="module")
def flow(mug):
    return gt.GraspTransfer(mug, estimator="rigid")


@pytest.fixture(scope="module")
def result(flow, seen, few_views):
    return flow.transfer(seen[0], None, camera=CAMERA, box=seen[1])


@pytest.fixture(scope="module")
def found(result):
    return result.found_poses


def test_the_true_pose_is_among_the_proposals(found):
    turns = [np.rad2deg(rotation_angle(one.camera_from_object[:3, :3].T @ POSE[:3, :3])) for one in found]
    assert min(turns) < 16
    nearest = found[int(np.argmin(turns))]
    # Size and distance cannot be told apart: as far as mugs differ in size.
    assert np.linalg.norm(nearest.camera_from_object[:3, 3] - POSE[:3, 3]) < 0.25 * POSE[2, 3]


def test_chances_fall_and_sum_to_at_most_one(found):
    stated = [one.chance for one in found]
    assert stated == sorted(stated, reverse=True)
    assert 0 < sum(stated) <= 1


def test_a_proposals_uncertainty_is_one_that_a_transfer_takes(found, seen, flow):
    sigma = found[0].pose_sigma
    assert np.linalg.eigvalsh(sigma).min() > 0
    assert found[0].deviation.along_ray > found[0].deviation.across_ray
    assert flow.transfer(seen[0], found[0].camera_from_object, camera=CAMERA, pose_sigma=sigma).grasps


def test_a_transfer_without_a_pose_says_that_it_found_one(flow, seen, result):
    assert result.found_poses
    np.testing.assert_allclose(result.camera_from_object, result.found_poses[0].camera_from_object)
    assert "No pose was given" in result.pose_note
    given = flow.transfer(seen[0], result.camera_from_object, camera=CAMERA, box=seen[1])
    assert given.pose_note is None
    same = {grasp.name: grasp.score for grasp in given.grasps}
    for grasp in result.grasps:
        assert grasp.score == pytest.approx(same[grasp.name] * result.found_poses[0].chance, abs=1e-9)


def test_a_box_that_is_none_is_refused_before_the_search(mug, seen):
    with pytest.raises(ImageError, match="box"):
        gt.find_pose(seen[0], mug, camera=CAMERA, box=(200, 10, 100, 50))


def test_the_table_of_a_scene_on_which_the_object_stands_counts(flow, seen, monkeypatch):
    class Asked(Exception):
        pass

    def find_in(finder, seen, *, camera_from_table=None):
        raise Asked(camera_from_table)

    monkeypatch.setattr(finder.PoseFinder, "find_in", find_in)
    bottom = POSE @ rigid(np.eye(3), np.array([0.0, 0.0, -0.05]))
    plane = bottom[:3, 3], POSE[:3, 2]
    for stands in (True, False):
        scene = gt.Scene(support_plane=plane, stands=stands)
        with pytest.raises(Asked) as asked:
            flow.transfer(seen[0], None, camera=CAMERA, box=seen[1], scene=scene)
        table = asked.value.args[0]
        if not stands:
            assert table is None
            continue
        np.testing.assert_allclose(table[:3, 3], bottom[:3, 3])
        np.testing.assert_allclose(table[:3, 2], POSE[:3, 2], atol=1e-12)


def test_a_picture_without_box_or_mask_is_refused(mug, seen):
    with pytest.raises(ImageError, match=r"box.*needed to find a pose"):
        gt.find_pose(seen[0], mug, camera=CAMERA)


@pytest.mark.parametrize("box", [(40.0, 60.0, 120.0, 160.0), (200.0, 20.0, 300.0, 90.0)])
def test_the_pose_in_a_box_fills_it(mug, box):
    points = np.asarray(mug.canonical.vertices)
    for rotation in grid.view_rotations()[::17]:
        u0, v0, u1, v1 = projected_box(points, CAMERA, grid.pose_in_box(points, CAMERA, rotation, box))
        assert (u0 + u1) / 2 == pytest.approx((box[0] + box[2]) / 2, abs=1.0)
        assert (v0 + v1) / 2 == pytest.approx((box[1] + box[3]) / 2, abs=1.0)
        assert (u1 - u0) * (v1 - v0) == pytest.approx((box[2] - box[0]) * (box[3] - box[1]), rel=0.03)


def test_fitted_weights_find_the_trait_that_speaks():
    rng = np.random.default_rng(0)
    traits = [rng.normal(size=(6, 3)) for _ in range(60)]
    right = [np.arange(6) == np.argmax(one[:, 1]) for one in traits]
    weights = chances.fit_weights_of_traits(traits, right, none=False)
    assert weights.by_trait[1] > 5 * np.abs(weights.by_trait[[0, 2]]).max()
    hits = [
        np.argmax(weights.chances(one)) == np.argmax(truth) for one, truth in zip(traits, right, strict=True)
    ]
    assert np.mean(hits) > 0.9


def test_where_most_pictures_have_no_right_proposal_none_is_likely():
    rng = np.random.default_rng(1)
    traits = [rng.normal(size=(4, 2)) for _ in range(80)]
    right = [np.arange(4) == (0 if number < 20 else 9) for number in range(80)]
    weights = chances.fit_weights_of_traits(traits, right, none=True)
    assert np.mean([weights.chances(one).sum() for one in traits]) == pytest.approx(0.25, abs=0.05)


def test_written_chances_are_read_again(tmp_path):
    views = chances.Weights(np.arange(len(VIEW_TRAITS), dtype=float))
    poses = chances.Weights(np.ones(len(POSE_TRAITS)), -2.0)
    deviation = {"along_ray": 0.1, "across_ray": 0.01, "turn": 5.0}
    chances.write_chances(tmp_path / "poses.yaml", views, poses, deviation)
    read = chances.FittedChances.read(tmp_path / "poses.yaml")
    np.testing.assert_allclose(read.views.by_trait, views.by_trait)
    assert (read.poses.none, read.along_ray, read.turn) == (-2.0, 0.1, 5.0)
    with pytest.raises(WeightsError, match="nowhere"):
        chances.FittedChances.read(tmp_path / "nowhere.yaml")


def test_a_body_of_revolution_may_be_turned_and_a_mug_may_not(mug):
    import trimesh

    assert len(symmetry_turns(trimesh.creation.cylinder(0.03, 0.15, sections=90))) == 24
    assert np.rad2deg(symmetry_turns(trimesh.creation.box((0.03, 0.08, 0.15)))) == pytest.approx([0, 180])
    assert symmetry_turns(mug.canonical) == (0.0,)


def test_errors_of_proposals_are_those_made():
    turn = rigid(np.array([[0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]]), np.zeros(3))
    moved = POSE @ turn
    moved[:3, 3] *= 1.1
    error = pose_error(moved, POSE, (0.0,), found_bounds=BOUNDS, true_bounds=BOUNDS)
    assert error.degrees == pytest.approx(90)
    assert error.along_ray == pytest.approx(0.1)
    assert error.across_ray == pytest.approx(0, abs=1e-9)
    same = pose_error(POSE @ turn, POSE, (0.0, np.pi / 2), found_bounds=BOUNDS, true_bounds=BOUNDS)
    assert same.degrees == pytest.approx(0, abs=1e-6)
    assert same.iou == pytest.approx(1, abs=0.01)
    away = POSE.copy()
    away[0, 3] += 0.05
    half = pose_error(away, POSE, (0.0,), found_bounds=BOUNDS, true_bounds=BOUNDS)
    assert 0.1 < half.iou < 0.6


def test_the_benchmark_counts_the_first_proposal_and_the_best():
    from grasptransfer.workshop.benchmark.pose_summary import summarise_poses
    from grasptransfer.workshop.benchmark.tables import rows_table

    near = {"chance": 0.2, "degrees": 4.0, "metres": 0.03, "iou": 0.6}
    far = {"chance": 0.7, "degrees": 170.0, "metres": 0.02, "iou": 0.4}
    rows = [
        {"category": "mug", "image": "a.png", "seconds": 1.0, "proposals": [far, near]},
        {"category": "mug", "image": "b.png", "seconds": 2.0, "proposals": []},
    ]
    summary = summarise_poses(rows)
    assert (summary["pictures"], summary["without_proposal"]) == (2, 1)
    assert (summary["deg10_cm10"], summary["deg10_cm10_best_of_list"]) == (0, 0.5)
    assert (summary["deg5_cm5_best_of_list"], summary["iou50_best_of_list"]) == (0.5, 0.5)
    assert summary["stated"] == pytest.approx(0.35)
    assert rows_table({"benchmark": "pose", "rows": rows}) is None
