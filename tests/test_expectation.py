"""The E-step alone: boxes out of reach are skipped, and nothing else."""

import numpy as np
import pytest
from bent_ellipsoids import BACKENDS, pair

from grasptransfer.registration.blocks import BLOCK, spatial_order
from grasptransfer.registration.expectation import EStep


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("spread", [1.0, 0.1, 0.02, 0.003])
def test_the_expectation_is_that_of_all_pairs(backend, spread):
    source, target = (cloud / 0.07 for cloud in pair(333, target_count=257))
    source = source[spatial_order(source, BLOCK)]
    squared = np.square(source[:, None] - target).sum(2)
    closeness = np.exp((squared.min(0) - squared) / (2 * spread**2))
    matches = closeness / closeness.sum(0)
    with EStep(target, len(source), backend=backend, threads=1) as expect:
        for moved in (source + 0.05, source):  # the bounds of the first call must hold for the second
            found = expect(moved, spread**2)
    np.testing.assert_allclose(found.support, matches.sum(1), atol=2e-4)
    np.testing.assert_allclose(found.moment, matches @ target, atol=2e-4)
    assert found.squared == pytest.approx((matches * squared).sum(), rel=1e-4)
    likelihood = np.log(closeness.sum(0)) - squared.min(0) / (2 * spread**2)
    assert found.log_likelihood == pytest.approx(likelihood.sum(), rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_threads_do_not_change_the_expectation(backend):
    source, target = (cloud / 0.07 for cloud in pair(1000))
    source = source[spatial_order(source, BLOCK)]
    found = []
    for threads in (1, 2):
        with EStep(target, len(source), backend=backend, threads=threads) as expect:
            found.append(expect(source, 0.01))
    np.testing.assert_allclose(found[0].moment, found[1].moment, atol=1e-4)  # float32 sums
    np.testing.assert_array_equal(found[0].inlier, found[1].inlier)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK - 3])
def test_boxes_that_are_not_full_count_no_point_twice(backend, count):
    source, target = (cloud / 0.07 for cloud in pair(count, target_count=70))
    source = source[spatial_order(source, BLOCK)]
    squared = np.square(source[:, None] - target).sum(2)
    closeness = np.exp((squared.min(0) - squared) / (2 * 0.3**2))
    with EStep(target, count, backend=backend) as expect:
        found = expect(source, 0.3**2)
    np.testing.assert_allclose(found.support, (closeness / closeness.sum(0)).sum(1), rtol=1e-4, atol=1e-5)
    assert found.support.sum() == pytest.approx(len(target), rel=1e-5)  # float32 sums


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("log_outlier", [-3.0, 5.0, 200.0])
def test_outliers_take_their_share(backend, log_outlier):
    source, target = (cloud / 0.07 for cloud in pair(90, target_count=70))
    source = source[spatial_order(source, BLOCK)]
    exponents = -np.square(source[:, None] - target).sum(2) / (2 * 0.1**2)
    inlier = np.logaddexp.reduce(exponents, axis=0)
    everything = np.logaddexp(inlier, log_outlier)
    with EStep(target, len(source), backend=backend) as expect:
        found = expect(source, 0.1**2, log_outlier=log_outlier)
    np.testing.assert_allclose(found.inlier, np.exp(inlier - everything), rtol=1e-3, atol=1e-12)
    assert found.log_likelihood == pytest.approx(everything.sum(), rel=1e-5)
