"""The depth camera: its noise law, and what glass does to it."""

import numpy as np
import pytest

from grasptransfer.camera import Camera
from grasptransfer.errors import SettingsError
from grasptransfer.perception.depth_sensor import DepthSensor, wall_behind

CAMERA = Camera.from_fov(160, 120, np.deg2rad(60))
SHAPE = (120, 160)
MIDDLE = (slice(30, 90), slice(40, 120))


def _box(depth: float) -> np.ndarray:
    """A flat front that faces the camera."""
    picture = np.zeros(SHAPE)
    picture[MIDDLE] = depth
    return picture


def _measure(sensor: DepthSensor, coverage: float, *, seed: int = 0, path=None) -> np.ndarray:
    depth = _box(0.6)
    behind = wall_behind(CAMERA, 1.0)
    opacity = np.where(depth > 0, coverage, 0.0)
    rng = np.random.default_rng(seed)
    return sensor.measure(depth, opacity, behind, camera=CAMERA, rng=rng, path=path)


def _inside(picture: np.ndarray) -> np.ndarray:
    return picture[34:86, 44:116]  # away from the front's border


def test_an_opaque_object_is_measured_everywhere_within_the_noise():
    sensor = DepthSensor()
    measured = _inside(_measure(sensor, 1.0))
    assert (measured > 0).all()
    sigma = 0.6**2 * sensor.subpixel / (CAMERA.fx * sensor.baseline)
    # 52 x 72 pixels, 3 px windows: some hundred independent errors.
    assert measured.std() == pytest.approx(sigma, rel=0.25)
    assert abs(measured.mean() - 0.6) < sigma / 2


def test_noise_grows_with_the_square_of_the_distance():
    spread = {}
    for distance in (0.5, 1.0):
        wall = wall_behind(CAMERA, distance)
        empty = np.zeros(SHAPE)
        rng = np.random.default_rng(1)
        spread[distance] = (DepthSensor().measure(empty, empty, wall, camera=CAMERA, rng=rng) - wall).std()
    # Exactly 4 to first order; the disparity's noise is no longer small beside a far one.
    assert spread[1.0] / spread[0.5] == pytest.approx(4.0, rel=0.05)


def test_clear_glass_gives_holes_and_what_lies_behind_but_not_itself():
    measured = _inside(_measure(DepthSensor(through=0.5), 0.0))
    missing = (measured == 0).mean()
    behind = np.abs(measured - 1.0) < 0.1
    assert 0.25 < missing < 0.8
    assert 0.2 < behind.mean() < 0.75
    assert (np.abs(measured - 0.6) < 0.1).mean() == 0


@pytest.mark.parametrize("coverage", [0.25, 0.75])
def test_the_share_of_measured_glass_is_its_opacity(coverage):
    shares = [
        (np.abs(_inside(_measure(DepthSensor(), coverage, seed=s)) - 0.6) < 0.05).mean() for s in range(8)
    ]
    # Patches of 8 px: some thirty independent ones in each of eight pictures; borders of patches are lost.
    assert np.mean(shares) == pytest.approx(coverage, abs=0.15)


def test_refraction_brings_what_lies_behind_nearer():
    sensor = DepthSensor(through=1.0, refraction=1.33, subpixel=0.0)
    path = np.full(SHAPE, 0.08)
    straight, bent = _measure(sensor, 0.0), _measure(sensor, 0.0, path=path)
    shift = (_inside(straight) - _inside(bent))[_inside(bent) > 0]
    np.testing.assert_allclose(shift, 0.08 * (1 - 1 / 1.33), rtol=1e-6)


def test_slanted_surfaces_are_lost():
    columns = np.broadcast_to(np.arange(SHAPE[1]), SHAPE)
    slanted = 0.6 + 0.008 * (columns - 80.0)  # 8 mm away at 4 to 6 mm sideways a pixel: about 60 degrees
    one = np.ones(SHAPE)
    for limit, kept in ((50, False), (78, True)):
        sensor = DepthSensor(subpixel=0.0, slant=np.deg2rad(limit))
        measured = sensor.measure(slanted, one, one, camera=CAMERA, rng=np.random.default_rng(0))
        assert ((measured > 0)[20:100, 80:100] == kept).all()


def test_borders_are_lost():
    measured = _measure(DepthSensor(subpixel=0.0), 1.0)
    assert measured[60, 40] == 0  # the front's first column
    assert (measured[60, [37, 42]] > 0).all()


def test_the_same_seed_gives_the_same_picture():
    np.testing.assert_array_equal(_measure(DepthSensor(), 0.5), _measure(DepthSensor(), 0.5))


def test_a_tilted_wall_crosses_the_axis_at_its_distance():
    wall = wall_behind(CAMERA, 0.8, tilt=0.4, turn=0.0)
    middle = wall[round(CAMERA.cy), round(CAMERA.cx)]
    assert middle == pytest.approx(0.8, rel=0.01)
    assert wall[60, 10] > 0.8 > wall[60, 150]


def test_impossible_sensors_are_refused():
    with pytest.raises(SettingsError, match="through"):
        DepthSensor(through=1.5)
