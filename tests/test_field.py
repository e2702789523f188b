"""Deformation fields: laws and bad input."""

import logging

import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from smooth_fields import SIZE, cloud, fitted, smooth_target

from grasptransfer.errors import PointCloudError, SettingsError
from grasptransfer.registration import DeformationField, register_pair
from grasptransfer.registration.kernels import gaussian


@pytest.fixture
def as_users_run_it():
    """Without the run-time type checker of the tests, which would answer first."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


seeds = st.integers(0, 10_000)


@settings(max_examples=20)
@given(seed=seeds, beta=st.floats(0.1, 3))
def test_zero_weights_are_the_identity(seed, beta):
    points = cloud(30, seed)
    field = DeformationField.identity(points, beta=beta)
    others = cloud(20, seed + 1)
    assert np.array_equal(field(others), others)
    assert np.array_equal(field.jacobian(others), np.broadcast_to(np.eye(3), (20, 3, 3)))
    assert np.array_equal(field.inverse(others), others)


@settings(max_examples=20)
@given(seed=seeds, beta=st.floats(0.3, 3))
def test_the_displacement_is_the_formula(seed, beta):
    rng = np.random.default_rng(seed)
    control, weights, points = cloud(15, seed), rng.normal(size=(15, 3)), cloud(7, seed + 1)
    field = DeformationField(control, weights, beta, np.array([0.01, 0.02, 0.03]), 0.05)
    squared = np.square((points[:, None] - control) / 0.05).sum(2)
    expected = 0.05 * np.exp(-squared / (2 * beta**2)) @ weights
    np.testing.assert_allclose(field.displacement(points), expected, atol=1e-13)  # float64 rounding
    np.testing.assert_allclose(field(points), points + expected, atol=1e-13)


@settings(max_examples=20)
@given(seed=seeds, beta=st.floats(0.3, 2))
def test_the_jacobian_is_that_of_finite_differences(seed, beta):
    rng = np.random.default_rng(seed)
    field = DeformationField(cloud(30, seed), rng.normal(size=(30, 3)), beta, np.zeros(3), SIZE)
    points, step = cloud(10, seed + 1), 1e-5 * SIZE
    columns = [(field(points + step * axis) - field(points - step * axis)) / (2 * step) for axis in np.eye(3)]
    # Central differences err by step^2 |v'''| / 6, v''' at most some 100 / beta^3 here, and by rounding.
    np.testing.assert_allclose(field.jacobian(points), np.stack(columns, axis=2), atol=1e-6)


@settings(max_examples=10)
@given(seed=seeds)
def test_the_inverse_undoes_the_field(seed):
    field, points = fitted(seed), cloud(50, seed + 1)
    found = field.inverse(field(points))
    np.testing.assert_allclose(found, points, atol=1e-5 * SIZE)  # accepted at 1e-7, the Jacobian is near I


def test_a_folded_field_inverts_as_far_as_it_can_and_says_so(caplog):
    points = np.array([[0.0, 0, 0], [0.05, 0, 0]])
    folded = DeformationField(points, np.array([[3.0, 0, 0], [-3.0, 0, 0]]), 0.5, np.zeros(3), 0.05)
    wanted = np.stack([np.linspace(-0.3, 0.3, 200), np.zeros(200), np.zeros(200)], axis=1)
    with caplog.at_level(logging.WARNING):
        found = folded.inverse(wanted)
    assert np.isfinite(found).all()
    reached = np.linalg.norm(folded(found) - wanted, axis=1) <= 1e-7 * 0.05
    assert reached.all() or "folds" in caplog.text


@settings(max_examples=15)
@given(seed=seeds, beta=st.floats(0.5, 2))
def test_a_fit_recovers_a_field_of_its_own_kind(seed, beta):
    rng = np.random.default_rng(seed)
    control = cloud(60, seed)
    true = DeformationField.fit(control, control, control + 0.004 * rng.normal(size=control.shape), beta=beta)
    points = cloud(300, seed + 1)
    found = DeformationField.fit(control, points, true(points), beta=beta, regularisation=1e-9)
    # 1e-9 of regularisation and a factor good to 1e-10 leave a ten-thousandth of the displacement.
    assert np.abs(found(points) - true(points)).max() < 1e-3 * np.abs(true.displacement(points)).max()


def test_a_fit_goes_through_smooth_correspondences():
    points = cloud(400)
    field = DeformationField.fit(points, points, smooth_target(points), beta=1.0)
    others = cloud(100, 1)
    assert np.abs(field(points) - smooth_target(points)).max() < 1e-4
    # Between the known points, too: a tenth of a millimetre, half a millimetre at the cloud's rim.
    assert np.median(np.linalg.norm(field(others) - smooth_target(others), axis=1)) < 1e-4


def test_stronger_regularisation_bends_less():
    points = cloud(100)
    noisy = points + np.random.default_rng(0).normal(size=points.shape) * 0.01
    bending = []
    for regularisation in (1e-6, 1e-3, 1.0, 1e3):
        field = DeformationField.fit(points, points, noisy, beta=0.5, regularisation=regularisation)
        normalised = field.normaliser(points)
        bending.append(np.trace(field.weights.T @ gaussian(normalised, normalised, 0.5) @ field.weights))
    assert bending == sorted(bending, reverse=True)


def test_many_points_at_once_equal_few():
    field, points = fitted(count=500), cloud(20_000, 5)
    together = field(points)
    np.testing.assert_allclose(together[:50], field(points[:50]), atol=1e-8 * SIZE)  # compressed above
    np.testing.assert_allclose(field.jacobian(points)[:50], field.jacobian(points[:50]), atol=1e-5)


def test_no_points_give_no_points():
    field = fitted()
    assert field(np.zeros((0, 3))).shape == (0, 3)
    assert field.jacobian(np.zeros((0, 3))).shape == (0, 3, 3)
    assert field.inverse(np.zeros((0, 3))).shape == (0, 3)


def test_a_pair_goes_from_a_through_the_canonical_to_b():
    field_a, field_b = fitted(0), fitted(0, beta=2.0)
    points = cloud(60, 9)
    pair = register_pair(field_a, field_b)
    on_a = field_a(points)
    # The inverse is accepted at 1e-7 of the scale.
    np.testing.assert_allclose(pair(on_a), field_b(points), atol=1e-5 * SIZE)
    np.testing.assert_allclose(pair.inverse(pair(on_a)), on_a, atol=1e-5 * SIZE)
    np.testing.assert_allclose(pair.displacement(on_a), pair(on_a) - on_a, atol=1e-12)
    step = 1e-4 * SIZE
    columns = [(pair(on_a + step * axis) - pair(on_a - step * axis)) / (2 * step) for axis in np.eye(3)]
    np.testing.assert_allclose(pair.jacobian(on_a), np.stack(columns, axis=2), atol=5e-3)


def test_a_pair_of_one_field_is_the_identity():
    field, points = fitted(), cloud(60, 9)
    np.testing.assert_allclose(register_pair(field, field)(points), points, atol=1e-6 * SIZE)


def test_arrays_are_read_only_copies():
    points = cloud(10)
    field = DeformationField.identity(points)
    points[0] = 99.0
    assert field.control_points[0, 0] != 99.0
    with pytest.raises(ValueError, match="read-only"):
        field.weights[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "error", "name"),
    [
        ({"weights": np.zeros((9, 3))}, PointCloudError, "weights"),
        ({"weights": np.full((10, 3), np.nan)}, PointCloudError, "weights"),
        ({"control_points": np.zeros((10, 2))}, PointCloudError, "control_points"),
        ({"centre": np.zeros(2)}, PointCloudError, "centre"),
        ({"beta": 0.0}, SettingsError, "beta"),
        ({"beta": float("nan")}, SettingsError, "beta"),
        ({"scale": -1.0}, SettingsError, "scale"),
    ],
)
@pytest.mark.usefixtures("as_users_run_it")
def test_an_impossible_field_is_refused_by_name(change, error, name):
    parts = {
        "control_points": cloud(10),
        "weights": np.zeros((10, 3)),
        "beta": 1.0,
        "centre": np.zeros(3),
        "scale": 1.0,
    }
    with pytest.raises(error, match=name):
        DeformationField(**{**parts, **change})


def test_points_with_nan_are_refused():
    with pytest.raises(PointCloudError, match="NaN"):
        fitted()(np.array([[0.0, np.nan, 0]]))


@pytest.mark.usefixtures("as_users_run_it")
def test_unequal_correspondences_are_refused():
    with pytest.raises(PointCloudError, match="targets"):
        DeformationField.fit(cloud(20), cloud(20), cloud(19))


def test_a_large_mesh_needs_little_memory():
    import tracemalloc

    field, points = fitted(count=500), cloud(200_000, 1)
    field(points[:20_000])
    tracemalloc.start()
    field(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6  # all pairs would be 800 MB; the points alone are 5
