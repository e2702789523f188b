"""The Gaussian kernel and its low-rank factors, beside the full matrix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from smooth_fields import SIZE, cloud, fitted

from grasptransfer.registration.kernels import (
    PrincipalKernel,
    compress,
    gaussian,
    gaussian_times,
    pivoted_cholesky,
)


@pytest.mark.parametrize("beta", [0.5, 1.0, 2.0])
def test_compressing_does_not_change_the_field(beta):
    field = fitted(beta=beta, count=600)
    normalised = field.normaliser(field.control_points)
    centres, weights = compress(normalised, beta, field.weights)
    others = field.normaliser(cloud(500, 3))
    plain = gaussian_times(others, normalised, beta, field.weights)
    # The tolerance is 1e-11 in the kernel's norm; fitted weights reach some thousands.
    assert np.abs(gaussian_times(others, centres, beta, weights) - plain).max() < 1e-6 * np.abs(plain).max()


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000), beta=st.floats(0.2, 3), tolerance=st.sampled_from([1e-3, 1e-7, 1e-10]))
def test_the_kernels_factor_is_as_good_as_asked(seed, beta, tolerance):
    points = cloud(80, seed) / SIZE
    factor = pivoted_cholesky(points, beta, tolerance=tolerance).factor
    # The largest entry of a positive semidefinite remainder is on its diagonal; 1e-14: rounding.
    assert np.abs(factor @ factor.T - gaussian(points, points, beta)).max() <= tolerance + 1e-14


@pytest.mark.parametrize("beta", [0.5, 2.0])
def test_the_principal_kernel_is_orthogonal_and_as_good_as_asked(beta):
    points = cloud(300, 1) / SIZE
    kernel = PrincipalKernel.of(points, beta, tolerance=1e-7)
    products = kernel.factor.T @ kernel.factor
    np.testing.assert_allclose(products, np.diag(kernel.strengths), atol=1e-12 * kernel.strengths.max())
    missed = gaussian(points, points, beta) - kernel.factor @ kernel.factor.T
    assert np.abs(missed).max() < 2e-7  # the Cholesky factor's share, and that of what was left out
    coefficients = np.random.default_rng(0).normal(size=(len(kernel.strengths), 3))
    weights = kernel.shortest_weights(coefficients)
    np.testing.assert_allclose(kernel.factor.T @ weights, coefficients, atol=1e-6)
    shortest = np.linalg.lstsq(kernel.factor.T, coefficients, rcond=None)[0]
    np.testing.assert_allclose(weights, shortest, rtol=1e-4, atol=1e-4 * np.abs(shortest).max())
