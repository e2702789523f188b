"""Everything that is shipped and loaded is vouched for by a checksum; one changed bit in it is refused."""

import shutil
from pathlib import Path

import pytest

import grasptransfer as gt
from grasptransfer.category import Category, load_category, objects_folder
from grasptransfer.errors import GraspTransferError, WeightsError
from grasptransfer.perception.networks import feature_weights
from grasptransfer.perception.weights import find_weights, read_weights

NAMES = gt.list_categories()
# A person writes the grasps, in an editor too; the demo's picture is an example. Both are checked when read.
WITHOUT = {"category.yaml", "grasps.yaml"}


def _spoil(path: Path) -> None:
    """Change one bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("name", NAMES)
def test_a_category_vouches_for_every_file_in_its_folder(name):
    category = load_category(name)
    files = (path for path in category.folder.rglob("*") if path.is_file())
    found = {path.relative_to(category.folder).as_posix() for path in files}
    found = {path for path in found if not path.startswith(("demo/", "."))} - WITHOUT
    assert found == set(category.file.checksums)


LOADED = {
    "canonical.glb": lambda category: category.canonical,
    "shape_space.npz": lambda category: category.shape_space,
    "fields.npz": lambda category: category.field(category.train[0]),
    "instances": lambda category: category.instance_mesh(category.train[0]),
}


@pytest.mark.parametrize("part", LOADED)
def test_a_changed_bit_in_a_category_is_refused_when_it_is_loaded(part, tmp_path):
    shutil.copytree(objects_folder() / "mug", tmp_path / "mug")
    category: Category = load_category(tmp_path / "mug")
    path = category.folder / part
    if path.is_dir():
        path = path / f"{category.train[0]}.glb"
    _spoil(path)
    with pytest.raises(GraspTransferError, match="is corrupt: its checksum") as caught:
        LOADED[part](category)
    assert caught.value.path == path


def test_a_changed_bit_in_trained_weights_is_refused(tmp_path):
    shipped = find_weights(load_category("mug"))
    for suffix in (".safetensors", ".yaml"):
        shutil.copy(shipped.with_suffix(suffix), tmp_path)
    path = tmp_path / shipped.name
    assert read_weights(path).members > 0
    _spoil(path)
    with pytest.raises(WeightsError, match="is corrupt: the checksum"):
        read_weights(path)


def test_numbers_that_were_fitted_to_other_weights_are_refused(tmp_path):
    shipped = find_weights(load_category("mug"))
    for suffix in (".safetensors", ".yaml"):
        shutil.copy(shipped.with_suffix(suffix), tmp_path)
    beside = tmp_path / f"{shipped.stem}.yaml"
    text = beside.read_text()
    given = text.split("fitted_to: ")[1].split()[0]
    beside.write_text(text.replace(given, "f" * 64))
    with pytest.raises(WeightsError, match="was fitted to other weights") as caught:
        read_weights(tmp_path / shipped.name)
    assert caught.value.path == beside


def test_a_changed_bit_in_the_picture_features_is_refused(tmp_path, monkeypatch):
    assert feature_weights.read_feature_weights()
    copy = Path(shutil.copy(feature_weights.FEATURES_FILE, tmp_path))
    monkeypatch.setattr(feature_weights, "FEATURES_FILE", copy)
    _spoil(copy)
    with pytest.raises(WeightsError, match="is corrupt: its checksum is another"):
        feature_weights.read_feature_weights()
    copy.unlink()
    with pytest.raises(WeightsError, match="is missing"):
        feature_weights.read_feature_weights()
