"""Networks that answer: by PyTorch and by OpenVINO alike, and from any thread."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.errors import SettingsError
from grasptransfer.perception import device as devices
from grasptransfer.perception.answering import load_answering
from grasptransfer.perception.weights import find_weights


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    monkeypatch.delenv(devices.VARIABLE, raising=False)


@pytest.fixture(scope="module")
def networks():
    mug = gt.load_category("mug")
    return [load_answering(find_weights(mug), mug, device=device)[0] for device in ("cpu", "openvino")]


def _picture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (1, 8, 192, 256)).astype(np.float32)


def test_openvino_and_pytorch_predict_alike(networks):
    for seed in range(2):
        by_torch, by_openvino = (network(_picture(seed)) for network in networks)
        for name, expected in by_torch._asdict().items():
            found = getattr(by_openvino, name)
            assert found.shape == expected.shape, name
            # Both round to float32 some hundred times, in different orders.
            np.testing.assert_allclose(found, expected, atol=1e-3, err_msg=name)


def test_a_network_answers_several_threads_at_once(networks):
    pictures = [_picture(seed) for seed in range(4)]
    for network in networks:
        alone = [network(picture).flow for picture in pictures]
        with ThreadPoolExecutor(4) as pool:
            beside = [answer.flow for answer in pool.map(network, pictures)]
        np.testing.assert_allclose(beside, alone, atol=1e-5)


def test_the_environment_stands_in_for_auto_alone(monkeypatch):
    monkeypatch.setattr(devices, "_has_gpu", lambda: False)
    assert devices.answering_device("auto") == "openvino"
    assert devices.answering_device("auto", openvino_serves=False) == "cpu"
    monkeypatch.setenv(devices.VARIABLE, "cpu")
    assert devices.answering_device("auto") == "cpu"
    assert devices.answering_device("openvino") == "openvino"
    monkeypatch.setenv(devices.VARIABLE, "tpu")
    with pytest.raises(SettingsError, match=f"{devices.VARIABLE}.*openvino"):
        devices.answering_device("auto")


def test_pytorch_answers_where_openvino_is_not_installed(monkeypatch):
    monkeypatch.setattr(devices, "_has_gpu", lambda: False)
    monkeypatch.setattr(devices, "_has_openvino", lambda: False)
    assert devices.answering_device("auto") == "cpu"
    with pytest.raises(SettingsError, match=r"grasptransfer\[fast\]"):
        gt.GraspTransfer("mug", device="openvino")


def test_a_gpu_comes_before_openvino_and_openvino_does_not_train(monkeypatch):
    monkeypatch.setattr(devices, "_has_gpu", lambda: True)
    assert devices.answering_device("auto") == "cuda"
    with pytest.raises(SettingsError, match="does not train"):
        devices.choose_device("openvino")


def test_openvino_refuses_other_numbers_than_float32():
    with pytest.raises(SettingsError, match="float32"):
        gt.GraspTransfer("mug", device="openvino", precision="bfloat16")


def test_an_answer_by_openvino_needs_no_import_of_pytorch():
    code = """
import sys
import numpy as np
import grasptransfer as gt
flow = gt.GraspTransfer("mug", device="openvino")
flow.estimator.network(np.zeros((1, 8, 192, 256), np.float32))
print("torch" in sys.modules)
"""
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.strip() == "False"
