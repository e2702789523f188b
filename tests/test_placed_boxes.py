"""Boxes and poses against the truth: what does not show does not count, and NIoU leaves the size out."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasptransfer.drawing.views import look_at
from grasptransfer.frames import rigid
from grasptransfer.workshop.benchmark.placed_boxes import (
    PlacedTruth,
    bounds_of,
    mean_shares,
    summarise_placed,
)

POSE = look_at(0.5, 0.3, 0.5)


@pytest.fixture(scope="module")
def bar():
    return PlacedTruth.of(trimesh.creation.box((0.05, 0.1, 0.2)))


def test_the_truth_scores_perfectly(bar):
    score = bar.score(POSE, bar.bounds, POSE)
    # The boxes' common part is counted on a grid, whose points none lie on a face.
    assert (score.millimetres, score.iou, score.niou) == (0, 1, 1)
    assert score.degrees < 1e-5
    assert all(share == 1 for share in summarise_placed([score]).values())


def test_an_object_twice_as_large_and_as_far_is_right_but_for_its_size(bar):
    farther = POSE.copy()
    farther[:3, 3] *= 2
    score = bar.score(farther, 2 * bar.bounds, POSE)
    assert score.iou == 0
    assert score.niou == pytest.approx(1.0)


def test_half_a_box_aside_leaves_a_third(bar):
    aside = POSE @ rigid(np.eye(3), np.array([0.025, 0, 0]))
    assert bar.score(aside, bar.bounds, POSE).iou == pytest.approx(1 / 3, abs=0.02)


def test_the_turn_of_a_round_body_about_its_axis_does_not_count(bar):
    turned = POSE @ rigid(Rotation.from_rotvec([0, 0, 1.0]).as_matrix(), np.zeros(3))
    can = PlacedTruth.of(trimesh.creation.cylinder(0.03, 0.2, sections=64))
    assert can.score(turned, can.bounds, POSE).degrees < 1e-3
    assert bar.score(turned, bar.bounds, POSE).degrees == pytest.approx(np.rad2deg(1.0))


def test_means_are_over_the_rows_that_have_shares(bar):
    score = bar.score(POSE, bar.bounds, POSE)
    rows = [summarise_placed([score]), {"estimator": "rigid"}]
    assert mean_shares(rows)["iou50"] == 1
    points = np.array([[0.0, 1, 2], [3, -1, 0]])
    np.testing.assert_array_equal(bounds_of(points), [[0, -1, 0], [3, 1, 2]])
