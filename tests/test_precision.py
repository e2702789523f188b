"""In which numbers networks compute, and how little that changes their answers."""

import pytest
import torch

import grasptransfer as gt
from grasptransfer.errors import SettingsError
from grasptransfer.perception.precision import VARIABLE, arithmetic, choose_precision, multiplies_bfloat16


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
def test_a_processor_is_asked_for_its_instructions(flags, chosen, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: flags, raising=False)
    assert choose_precision("auto", "cpu") == chosen


def test_linux_is_asked_where_torch_does_not_say(monkeypatch):
    said = multiplies_bfloat16("cpu")
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    assert multiplies_bfloat16("cpu") == said


def test_the_environment_overrides_the_processor_and_the_argument_the_environment(monkeypatch):
    for asked, other in (("float32", "bfloat16"), ("bfloat16", "float32")):
        monkeypatch.setenv(VARIABLE, asked)
        assert choose_precision("auto", "cpu") == asked
        assert choose_precision(other, "cpu") == other


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
