"""The outline's residuals on discs whose borders are known."""

import numpy as np

from grasptransfer.camera import Camera
from grasptransfer.drawing.views import look_at
from grasptransfer.perception.picture_evidence import Motion, Outline, PictureEvidence
from grasptransfer.perception.pose_and_shape import fit_pose_and_shape
from grasptransfer.perception.silhouette import Silhouette
from grasptransfer.registration import DisplacementModel

CAMERA = Camera.from_fov(256, 192, np.deg2rad(40))
POSE = look_at(0.5, 0.4, 0.3)


def _disc(radius: float) -> np.ndarray:
    """Probability (48, 64) of a disc about the picture's centre; radius in zoomed pixels."""
    v, u = np.mgrid[0:48, 0:64] * 4 + 1.5
    return 1 / (1 + np.exp(np.hypot(u - CAMERA.cx, v - CAMERA.cy) - radius))


def _ball(radius: float, count: int = 3000) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points * radius / np.linalg.norm(points, axis=1, keepdims=True)


def _draw_ball(vertices, pose):
    radius = np.linalg.norm(vertices, axis=1).mean()
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    # A centred ball is seen as a disc of radius f r / sqrt(d^2 - r^2).
    seen = CAMERA.fx * radius / np.sqrt(pose[2, 3] ** 2 - radius**2)
    return np.hypot(u - CAMERA.cx, v - CAMERA.cy) < seen


def test_the_distance_is_positive_inside_and_zero_at_the_border():
    silhouette = Silhouette(_disc(50.0), CAMERA, _draw_ball)
    pixels = np.array([[CAMERA.cx, CAMERA.cy], [CAMERA.cx + 50, CAMERA.cy], [CAMERA.cx + 70, CAMERA.cy]])
    distance, slope, _ = silhouette.residuals(pixels)
    # The mask's cells are 4 px wide.
    np.testing.assert_allclose(distance, [50, 0, -20], atol=2)
    assert slope[1, 0] < -0.9  # it falls outwards


def test_far_borders_have_no_weight():
    silhouette = Silhouette(_disc(30.0), CAMERA, _draw_ball)
    _, _, weight = silhouette.residuals(np.array([[CAMERA.cx + 31, CAMERA.cy], [CAMERA.cx + 80, CAMERA.cy]]))
    assert weight[0] > 0
    assert weight[1] == 0


def test_a_mask_without_border_is_not_used():
    assert not Silhouette(np.zeros((48, 64)), CAMERA, _draw_ball).usable
    assert not Silhouette(np.ones((48, 64)), CAMERA, _draw_ball).usable


def test_a_larger_mask_makes_the_model_grow_to_it():
    points = _ball(0.05)
    basis = points[:, :, None] * 0.1  # one standard deviation: 10 % of size
    wanted = 0.058
    seen = CAMERA.fx * wanted / np.sqrt(0.5**2 - wanted**2)
    silhouette = Silhouette(_disc(seen), CAMERA, _draw_ball)
    few = points[:20]
    vague = Motion(
        np.zeros((20, 3)),
        np.full(20, 10.0),
        CAMERA.project(few @ POSE[:3, :3].T + POSE[:3, 3]),
        np.full(20, 1e4),
    )
    outline = Outline(silhouette, points, DisplacementModel(np.zeros_like(points), basis))
    model = DisplacementModel(np.zeros((20, 3)), basis[:20])
    fit = fit_pose_and_shape([PictureEvidence(vague, few, model, CAMERA, outline)], [POSE], [None])
    grown = 0.05 * (1 + 0.1 * fit.latent[0])
    # The mask's cells are 4 px or 2.5 mm wide; their border is interpolated to a fraction of that.
    assert abs(grown - wanted) < 0.0015


def test_a_mask_of_one_faint_cell_has_no_border():
    probability = np.zeros((48, 64), np.float32)
    probability[20, 30] = 0.55
    assert not Silhouette(probability, CAMERA, _draw_ball).usable
    assert Silhouette(_disc(50.0), CAMERA, _draw_ball).usable


def test_a_point_far_outside_the_mask_counts_less_than_one_as_far_inside():
    silhouette = Silhouette(_disc(50.0), CAMERA, _draw_ball)
    pixels = np.array([[CAMERA.cx + radius, CAMERA.cy] for radius in (30, 49, 51, 70)])
    _, _, weight = silhouette.residuals(pixels)
    assert weight[3] < 0.1 * weight[0]
    assert weight[2] > 0.5 * weight[1]


def _disc_with_finger(radius: float, length: float) -> np.ndarray:
    """Probability (48, 64) of a disc from which a bar 16 px wide sticks out to the right."""
    v, u = np.mgrid[0:48, 0:64] * 4 + 1.5
    bar = (np.abs(v - CAMERA.cy) < 8) & (u > CAMERA.cx) & (u < CAMERA.cx + radius + length)
    return np.maximum(_disc(radius), bar)


def test_the_tip_of_an_uncovered_part_asks_for_the_model_from_its_whole_length():
    points = _ball(0.05)
    seen = CAMERA.fx * 0.05 / np.sqrt(0.5**2 - 0.05**2)
    silhouette = Silhouette(_disc_with_finger(seen, 20.0), CAMERA, _draw_ball)
    meetings = silhouette.meetings(points, POSE)
    distance, slope, weight = meetings.residuals(
        CAMERA.project(points[meetings.vertices] @ POSE[:3, :3].T + POSE[:3, 3])
    )
    of_outline = slice(len(meetings.vertices) - len(meetings.border))
    tip = np.argmax(distance)
    assert distance[of_outline].max() < 10  # half the bar's width is the farthest from any border
    assert 17 < distance[tip] < 23
    np.testing.assert_allclose(slope[tip], [-1, 0], atol=0.1)
    assert weight[tip] > 0


def test_no_border_is_met_where_the_mask_is_cut_off_by_the_picture():
    u = np.mgrid[0:48, 0:64][1]
    silhouette = Silhouette((u > 15).astype(float), CAMERA, _draw_ball)
    pixels, normals = silhouette.border
    np.testing.assert_allclose(pixels[:, 0], pixels[0, 0], atol=0.5)
    np.testing.assert_allclose(normals, np.tile([1.0, 0.0], (len(normals), 1)), atol=0.1)
    far = silhouette.meetings(_ball(0.02), POSE)
    assert len(far.border) == 0  # nothing of the model is near
    assert len(far.vertices) > 0
