"""In which numbers networks compute, and how little that changes their answers."""

import numpy as np
import pytest
import torch

import grasptransfer as gt
from grasptransfer.errors import SettingsError
from grasptransfer.frames import drift
from grasptransfer.perception.precision import (
    VARIABLE,
    answer_precision,
    arithmetic,
    multiplies_bfloat16,
    training_precision,
)


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)


@pytest.mark.parametrize(
    ("flags", "chosen"),
    [
        ({"avx2": True, "avx512_bf16": False, "amx_bf16": False}, "float32"),
        ({"avx2": True, "avx512_bf16": True, "l1d_cache_size": 32768}, "bfloat16"),
        ({"amx_bf16": True}, "bfloat16"),
    ],
)
def test_training_asks_the_processor_for_its_instructions(flags, chosen, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: flags, raising=False)
    assert training_precision("auto", "cpu") == chosen
    assert answer_precision("auto") == "float32"  # on all of them, so that they agree


def test_linux_is_asked_where_torch_does_not_say(monkeypatch):
    said = multiplies_bfloat16("cpu")
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    assert multiplies_bfloat16("cpu") == said


def test_the_environment_overrides_the_processor_and_the_argument_the_environment(monkeypatch):
    for asked, other in (("float32", "bfloat16"), ("bfloat16", "float32")):
        monkeypatch.setenv(VARIABLE, asked)
        assert training_precision("auto", "cpu") == asked
        assert training_precision(other, "cpu") == other
        assert answer_precision("auto") == asked
        assert answer_precision(other) == other


def test_unknown_precisions_are_refused_with_the_choices(monkeypatch):
    with pytest.raises(SettingsError, match=r"precision.*bfloat16"):
        gt.GraspTransfer("mug", estimator="rigid", precision="float16")
    monkeypatch.setenv(VARIABLE, "half")
    with pytest.raises(SettingsError, match=rf"{VARIABLE}.*bfloat16"):
        gt.GraspTransfer("mug", estimator="rigid")


@pytest.mark.parametrize(("precision", "type_"), [("float32", torch.float32), ("bfloat16", torch.bfloat16)])
def test_convolutions_compute_in_the_chosen_numbers(precision, type_):
    layer, picture = torch.nn.Conv2d(3, 4, 3), torch.rand(1, 3, 8, 8)
    with arithmetic(torch.device("cpu"), precision):
        assert layer(picture).dtype == type_


def test_answers_agree_across_threads_convolution_algorithms_and_libraries(monkeypatch):
    pose, camera = gt.load_pose("objects/mug/demo/pose.yaml"), gt.Camera.load("objects/mug/demo/camera.yaml")
    flow, results, threads = gt.GraspTransfer("mug", device="cpu"), [], torch.get_num_threads()

    def transfer(flow=flow):
        box = (284, 183, 404, 340)
        results.append(flow.transfer("objects/mug/demo/picture.png", pose, camera=camera, mask=box))

    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            transfer()
    finally:
        torch.set_num_threads(threads)
    with torch.backends.mkldnn.flags(enabled=False):  # as on processors that oneDNN does not know
        transfer()
    transfer(gt.GraspTransfer("mug", device="openvino"))
    for other in results[1:]:
        # Far below what a grasp notices: a tenth of a gripper's repeatability.
        np.testing.assert_allclose(other.latent, results[0].latent, atol=0.05)
        away = np.abs(drift(results[0].camera_from_object, other.camera_from_object))
        assert away[:3].max() < np.deg2rad(0.1)
        assert away[3:].max() < 0.0005
        verdicts = [{grasp.name: grasp.status for grasp in each.grasps} for each in (results[0], other)]
        assert verdicts[0] == verdicts[1]
