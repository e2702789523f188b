"""Weight files: which one serves a category, and what is refused."""

import dataclasses
import json

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from small_training_set import WIDTH

from grasptransfer.category import list_categories, load_category
from grasptransfer.errors import WeightsError
from grasptransfer.perception import weights as weights_module
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.networks.ensemble import Ensemble
from grasptransfer.perception.weights import (
    WeightsInfo,
    find_weights,
    load_weights,
    save_weights,
    trained_categories,
    trained_on,
)

MUG, BOTTLE = load_category("mug"), load_category("bottle")
BOTH = {"bottle": trained_on(BOTTLE), "mug": trained_on(MUG)}
STALE = trained_on(MUG) | {"canonical.glb": "older"}


@pytest.fixture
def models(tmp_path, monkeypatch):
    """An empty folder of weights."""
    monkeypatch.setattr(weights_module, "objects_folder", lambda: tmp_path)
    folder = tmp_path / "models"
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def ensemble():
    torch.manual_seed(0)
    return Ensemble([build_network("compact", 2, WIDTH)])


def test_the_weights_that_fit_a_category_serve_it_wherever_they_stand_in_the_alphabet(models, ensemble):
    joint = {"bottle": trained_on(BOTTLE), "mug": trained_on(MUG)}
    save_weights(models / "bottle-mug.safetensors", ensemble, WeightsInfo("compact", joint, width=WIDTH))
    save_weights(models / "mug.safetensors", ensemble, WeightsInfo("compact", {"mug": STALE}, width=WIDTH))
    assert find_weights(MUG) == models / "bottle-mug.safetensors"
    assert trained_categories() == ("bottle", "mug")


def test_several_weights_for_one_category_are_refused(models, ensemble):
    for name in ("a", "b"):
        info = WeightsInfo("compact", {"mug": trained_on(MUG)}, width=WIDTH)
        save_weights(models / f"{name}.safetensors", ensemble, info)
    with pytest.raises(WeightsError, match=r"a\.safetensors, b\.safetensors"):
        find_weights(MUG)


def test_weights_of_an_older_build_alone_are_named(models, ensemble):
    save_weights(models / "mug.safetensors", ensemble, WeightsInfo("compact", {"mug": STALE}, width=WIDTH))
    with pytest.raises(WeightsError, match=r"mug\.safetensors.*another canonical"):
        find_weights(MUG)


def test_a_folder_without_weights_is_to_be_trained_by_its_folder(models, tmp_path):
    own = dataclasses.replace(MUG, name="mycup", folder=tmp_path / "my cup")
    with pytest.raises(WeightsError, match=f"grasptransfer train '{tmp_path}/my cup'"):
        find_weights(own)


def test_weights_that_do_not_say_how_sure_they_may_be_are_refused(tmp_path, ensemble):
    path = tmp_path / "w.safetensors"
    save_weights(path, ensemble, WeightsInfo("compact", BOTH, width=WIDTH))
    path.with_suffix(".yaml").unlink()
    with pytest.raises(WeightsError, match=r"w\.yaml: does not exist"):
        load_weights(path)


def test_numbers_fitted_to_other_weights_are_refused(tmp_path, ensemble):
    save_weights(tmp_path / "a.safetensors", ensemble, WeightsInfo("compact", BOTH, width=WIDTH))
    other = Ensemble([build_network("compact", 2, WIDTH)])
    save_weights(tmp_path / "b.safetensors", other, WeightsInfo("compact", BOTH, width=WIDTH))
    (tmp_path / "b.yaml").replace(tmp_path / "a.yaml")
    with pytest.raises(WeightsError, match=r"a\.yaml.*fitted to other weights"):
        load_weights(tmp_path / "a.safetensors")


def test_weights_that_hold_their_confidence_themselves_as_older_ones_do_are_read(tmp_path, ensemble):
    path = tmp_path / "w.safetensors"
    save_weights(path, ensemble, WeightsInfo("compact", BOTH, width=WIDTH))
    path.with_suffix(".yaml").unlink()
    with safe_open(path, "pt") as file:
        header = file.metadata()
    numbers = {"bias": -3.0, "match": 1.0, "overlap": 0.5, "far": -2.0, "overconfidence": 4.5}
    save_file(load_file(path), path, metadata=header | {"confidence": json.dumps(numbers)})
    read = load_weights(path)[1].confidence.as_data()
    assert (
        read == Confidence(overconfidence=4.5).as_data()
    )  # verdicts as of a network that nothing was fitted to


def test_every_shipped_category_is_served_by_weights_trained_on_it():
    assert trained_categories() == list_categories()
    for name in list_categories():
        assert find_weights(load_category(name)).is_file()


def test_weights_come_back_as_they_were_saved(tmp_path):
    torch.manual_seed(1)
    network = Ensemble(build_network("compact", width=WIDTH) for _ in range(2)).eval()
    save_weights(
        tmp_path / "w.safetensors", network, WeightsInfo("compact", {"mug": trained_on(MUG)}, width=WIDTH)
    )
    loaded, info = load_weights(tmp_path / "w.safetensors")
    assert info == WeightsInfo("compact", {"mug": trained_on(MUG)}, width=WIDTH)
    for name, tensor in loaded.state_dict().items():
        torch.testing.assert_close(tensor, network.state_dict()[name].half().float())


@pytest.mark.parametrize("position", [20, -1000])
def test_a_flipped_byte_in_the_weights_is_found(tmp_path, position):
    path = tmp_path / "w.safetensors"
    save_weights(
        path,
        Ensemble([build_network("compact", width=WIDTH)]),
        WeightsInfo("compact", {"mug": trained_on(MUG)}, width=WIDTH),
    )
    data = bytearray(path.read_bytes())
    data[position] ^= 255
    path.write_bytes(data)
    with pytest.raises(WeightsError, match=r"w\.safetensors"):
        load_weights(path)


def test_missing_weights_say_how_to_train_them(tmp_path):
    with pytest.raises(WeightsError, match="grasptransfer train"):
        load_weights(tmp_path / "none.safetensors")
