"""What CPD is given: a clear error or the right answer, never NaN.

What peers do with it, measured with pycpd 2.0.0 and cycpd 0.28 at their default stop (probreg 0.3.8 and
bcpd 0.98 where an earlier measurement says so); none reports whether it converged:

| input | pycpd | cycpd | others |
| --- | --- | --- | --- |
| NaN in the target | all NaN, silent | scipy's ValueError | NaN, silent (probreg, bcpd) |
| infinity | all NaN, silent | all NaN, silent | |
| empty target | all NaN, silent | ZeroDivisionError | division errors |
| empty source | numpy's ValueError | ZeroDivisionError | |
| one target point, or all in one place | all points collapse to it, silent | the same | |
| one source point | infinite, silent | infinite, silent | |
| 2-D against 3-D, transposed | ValueError | ValueError | garbage (one) |
| float32 | right | TypeError: no matching signature | |
| whole numbers | right | TypeError: no matching signature | |
| coplanar, collinear, duplicates | right | right | |
| a cloud and its exact copy | right | right | Cholesky fails (bcpd) |
| 10 % far outliers, w = 0 | dragged away by 0.3 of the size, silent | the same | the same |
| millimetres against metres | does not move, silent | the same | |
| target a kilometre away | drags itself apart, silent | the same | |
| both a kilometre away, or raw metres | stops far too early, silent | right | |
"""

import numpy as np
import pytest
from bent_ellipsoids import BACKENDS, ellipsoid, pair
from scipy.spatial import KDTree

from grasptransfer.errors import PointCloudError, SettingsError
from grasptransfer.registration import cpd


def test_far_outliers_are_refused_or_with_a_weight_ignored():
    source, target = pair(300)
    polluted = np.concatenate([target, np.random.default_rng(0).normal(size=(30, 3)) * 2 + 5])
    with pytest.raises(PointCloudError, match="far outliers"):
        cpd(source, polluted)
    errors = [
        np.square(KDTree(cpd(source, cloud, outlier_weight=0.1)(source)).query(target)[0]).mean()
        for cloud in (target, polluted)
    ]
    assert errors[1] < 1.1 * errors[0]  # the larger first sigma changes EM's path a little


def with_value(value):
    cloud = ellipsoid(50, 0)
    cloud[7, 1] = value
    return cloud


BAD_CLOUDS = {
    "NaN": with_value(np.nan),
    "infinity": with_value(np.inf),
    "empty": np.zeros((0, 3)),
    "one point": np.zeros((1, 3)),
    "one place": np.ones((10, 3)),
    "two dimensions": ellipsoid(50, 0)[:, :2],
    "transposed": ellipsoid(50, 0).T,
    "one axis": np.arange(9.0),
    "text": np.array([["a", "b", "c"]]),
    "objects": np.array([None, 1, 2], dtype=object),
    "complex": ellipsoid(50, 0) + 1j,
    "far outliers": np.concatenate([ellipsoid(90, 0), ellipsoid(10, 1) + 3.0]),
    "millimetres": ellipsoid(50, 0) * 1000,
    "a kilometre away": ellipsoid(50, 0) + 1000.0,
}


@pytest.mark.parametrize("name", BAD_CLOUDS)
def test_a_bad_target_is_refused_by_name(name):
    with pytest.raises(PointCloudError, match="target"):
        cpd(ellipsoid(60, 1), BAD_CLOUDS[name])


@pytest.mark.parametrize(
    "name", [name for name in BAD_CLOUDS if name not in ("millimetres", "a kilometre away")]
)
def test_a_bad_source_is_refused_by_name(name):
    with pytest.raises(PointCloudError, match="source"):
        cpd(BAD_CLOUDS[name], ellipsoid(60, 1))


GOOD_CLOUDS = {
    "float32": ellipsoid(80, 0).astype(np.float32),
    "whole numbers": np.round(ellipsoid(80, 0) * 1000).astype(int),
    "coplanar": ellipsoid(80, 0) * [1, 1, 0],
    "collinear": ellipsoid(80, 0) * [0, 0, 1],
    "duplicates": np.repeat(ellipsoid(20, 0), 4, axis=0),
    "two points": np.array([[0.0, 0, 0], [0, 0, 0.1]]),
    "a kilometre away": ellipsoid(80, 0) + 1000.0,
    "not contiguous": ellipsoid(160, 0)[::2],
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", GOOD_CLOUDS)
def test_unusual_but_sound_clouds_are_registered(name, backend):
    source = GOOD_CLOUDS[name]
    size = float(np.ptp(source, axis=0).max())
    target = source * 1.0 + 0.1 * size
    result = cpd(source, target, backend=backend)
    moved = result(source.astype(float))
    assert np.isfinite(moved).all()
    assert KDTree(target).query(moved)[0].max() < 0.02 * size


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("beta", 0.0),
        ("beta", np.nan),
        ("lam", -1.0),
        ("outlier_weight", 1.0),
        ("outlier_weight", "guess"),
        ("tolerance", -1.0),
        ("max_iterations", 0),
        ("backend", "gpu"),
        ("align_first", "projective"),
        ("correspondence_std", 0.0),
        ("trait_std", -1.0),
    ],
)
def test_an_option_out_of_range_is_refused_by_name(key, value):
    with pytest.raises(SettingsError, match=key):
        cpd(*pair(30), **{key: value})


@pytest.mark.parametrize("pairs", [[[0, 99]], [[-1, 0]], [[0, 1, 2]], [[0.5, 1.0]]])
def test_impossible_correspondences_are_refused(pairs):
    with pytest.raises(PointCloudError, match="correspondences"):
        cpd(*pair(30), correspondences=np.array(pairs))


def test_traits_of_one_cloud_only_are_refused():
    with pytest.raises(PointCloudError, match="target_traits"):
        cpd(*pair(30), source_traits=np.zeros((30, 1)))
