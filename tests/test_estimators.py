"""One registry of estimators serves the API, the commands and the benchmarks."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.errors import ImageError, SettingsError, WeightsError
from grasptransfer.perception.estimators import ESTIMATORS, EstimatorSettings, make_estimator
from grasptransfer.perception.observation import observe
from grasptransfer.transfer import ESTIMATORS as OFFERED

POSE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.5], [0, 0, 0, 1]])
CAMERA = gt.Camera.from_fov(128, 96, np.deg2rad(50))


@pytest.fixture(scope="module")
def seen():
    return observe(np.full((96, 128, 3), 128, np.uint8), POSE, camera=CAMERA)


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if name not in ("rgb", "rgbd")])
def test_an_estimator_refuses_a_picture_without_what_the_registry_says_it_needs(name, seen):
    spec, estimator = ESTIMATORS[name], make_estimator(name, gt.load_category("mug"))
    if spec.needs_depth or spec.needs_box:
        with pytest.raises(ImageError, match="depth" if spec.needs_depth else "box"):
            estimator(seen)
    else:
        assert estimator(seen).field(np.zeros((1, 3))).shape == (1, 3)


def test_an_untrained_category_is_told_what_serves_until_it_is_trained():
    mug = gt.load_category("mug")
    untrained = replace(mug, name="teapot")
    with pytest.raises(WeightsError, match=r"grasptransfer train .*'cls' serves, with depth and a mask"):
        make_estimator("rgb", untrained)


def test_rgbd_answers_without_depth_as_rgb_does(seen):
    settings = EstimatorSettings(refine_pose=False, device="cpu")
    answers = [make_estimator(name, gt.load_category("mug"), settings)(seen) for name in ("rgb", "rgbd")]
    np.testing.assert_array_equal(answers[0].latent, answers[1].latent)


def test_the_api_offers_the_registry_and_commands_explain_each_entry(capsys):
    from grasptransfer.cli.main import main

    assert OFFERED is ESTIMATORS
    with pytest.raises(SystemExit):
        main(["transfer", "--help"])
    helped = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name, spec in ESTIMATORS.items():
        assert f"{name}: {spec.sentence}" in helped


def test_benchmarks_offer_the_registry_and_their_bound():
    from grasptransfer.workshop.benchmark.estimators import OF_GRASPS, OF_SHAPES

    for registry in (OF_GRASPS, OF_SHAPES):
        assert [name for name, spec in registry.items() if spec.bound] == ["gt"]
        assert list(registry)[1:] == list(ESTIMATORS)


def test_an_unknown_name_or_device_is_answered_with_the_known_ones():
    with pytest.raises(SettingsError, match="similarity"):
        make_estimator("magic", gt.load_category("mug"))
    with pytest.raises(SettingsError, match="auto"):
        EstimatorSettings(device="abacus")
