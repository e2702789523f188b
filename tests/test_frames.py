"""Rigid transforms: laws, and every wrong pose a user can give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasptransfer.errors import PoseError
from grasptransfer.frames import (
    check_rigid,
    invert,
    nearest_rotation,
    rigid,
    rotation_angle,
    rotation_matrix,
    rotation_vector,
    transform_points,
)

seeds = st.integers(0, 10_000)


def _random_transform(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rigid(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


@given(st.integers(0, 10**6), st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 2.6, 3.1, np.pi - 1e-6]))
def test_rotation_vectors_and_matrices_are_those_of_scipy(seed, angle):
    axis = np.random.default_rng(seed).normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    matrix = rotation_matrix(vector)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation_vector(matrix), vector, atol=1e-9)


@given(seeds)
def test_a_transform_times_its_inverse_is_the_identity(seed):
    a_from_b = _random_transform(seed)
    np.testing.assert_allclose(invert(a_from_b) @ a_from_b, np.eye(4), atol=1e-12)


@given(seeds, seeds)
def test_transforming_in_two_steps_equals_the_product(first, second):
    a_from_b, b_from_c = _random_transform(first), _random_transform(second)
    points = np.random.default_rng(first).normal(size=(5, 3))
    two_steps = transform_points(a_from_b, transform_points(b_from_c, points))
    np.testing.assert_allclose(two_steps, transform_points(a_from_b @ b_from_c, points), atol=1e-12)


@given(seeds, st.floats(1e-7, np.pi - 1e-7))
def test_the_angle_of_a_rotation_is_the_one_it_was_made_with(seed, angle):
    axis = np.random.default_rng(seed).normal(size=3)
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    # Rounding of a rotation matrix near pi moves the angle by its square root.
    assert rotation_angle(rotation) == pytest.approx(angle, abs=1e-6)


@given(seeds)
def test_the_nearest_rotation_is_proper_and_keeps_rotations(seed):
    rng = np.random.default_rng(seed)
    nearest = nearest_rotation(rng.normal(size=(4, 3, 3)))
    np.testing.assert_allclose(nearest @ nearest.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(nearest), 1, atol=1e-9)
    rotation = _random_transform(seed)[:3, :3]
    np.testing.assert_allclose(nearest_rotation(rotation), rotation, atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "word"),
    [
        (np.eye(3), "4x4"),
        ([[1, 2], [3]], "4x4"),
        ("nonsense", "4x4"),
        (np.diag([1.0, 1, -1, 1]), "reflection"),
        (np.diag([2.0, 2, 2, 1]), "scaled"),
        (np.full((4, 4), np.nan), "NaN"),
        ([[10**400, 0, 0, 0], *np.eye(4)[1:].tolist()], "4x4 matrix of numbers"),
        (rigid(np.eye(3), np.array([0, 0, 600.0])), "millimetres"),
        (rigid(np.eye(3), np.array([0, 0, 0.6])).T, "transposed"),
    ],
)
def test_a_wrong_pose_is_refused_with_its_reason(pose, word):
    with pytest.raises(PoseError, match=word):
        check_rigid(pose)


def test_a_slightly_rounded_pose_is_made_exactly_rigid():
    pose = np.round(_random_transform(3), 5)
    checked = check_rigid(pose)
    np.testing.assert_allclose(checked[:3, :3] @ checked[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(checked, pose, atol=2e-5)
