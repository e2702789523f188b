"""Training shapes: of whose category they are, and which instances they come from."""

import shutil

import numpy as np
import pytest
import yaml

from grasptransfer.category import Category, load_category
from grasptransfer.files import sha256
from grasptransfer.workshop.training.training_shapes import (
    draw_training_shape,
    has_generator,
    instances_of,
    training_canonical,
    without_held_out,
)


def _copy_of_mugs(folder, **changes) -> Category:
    """The shipped mugs as somebody's own category, with other entries in its `category.yaml`."""
    shutil.copytree(load_category("mug").folder, folder)
    path = folder / "category.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | changes))
    return load_category(folder)


@pytest.fixture
def own(tmp_path):
    return _copy_of_mugs(tmp_path / "mycup", name="mycup")


def test_an_own_category_is_trained_on_its_own_meshes(own):
    canonical = training_canonical(own)
    assert canonical.category.folder == own.folder
    assert not canonical.parametric
    shape = draw_training_shape(canonical, own.train, np.random.default_rng(0))
    sizes = {len(own.instance_mesh(name).vertices) for name in own.train}
    assert len(shape.vertices) in sizes
    assert shape.latent.shape == (canonical.n_modes,)


def test_held_out_shapes_are_instances_that_training_never_shows(own, monkeypatch):
    shown = []
    monkeypatch.setattr(
        Category, "instance_mesh", lambda category, name: shown.append(name) or category.canonical
    )
    canonical, rng = training_canonical(own), np.random.default_rng(0)
    for held_out, names in ((False, own.train), (True, own.test)):
        shown.clear()
        for _ in range(12):
            draw_training_shape(canonical, instances_of(own, held_out=held_out), rng)
        assert set(shown) <= set(names)


def test_a_category_without_test_instances_is_told(own, tmp_path):
    split = own.file.split.model_dump(mode="json") | {"test": []}
    bare = _copy_of_mugs(tmp_path / "bare", name="bare", split=split)
    assert instances_of(bare, held_out=True) == own.train
    assert without_held_out([load_category("mug"), own, bare]) == ["bare"]


def test_a_namesake_of_a_shipped_category_has_no_generator(tmp_path):
    assert has_generator(load_category("mug"))
    assert has_generator(_copy_of_mugs(tmp_path / "same"))
    namesake = _copy_of_mugs(tmp_path / "mug")
    other = load_category("bottle").folder / "canonical.glb"
    shutil.copyfile(other, namesake.folder / "canonical.glb")
    checksums = namesake.file.checksums | {"canonical.glb": sha256(other)}
    path = namesake.folder / "category.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"checksums": checksums}))
    namesake = load_category(namesake.folder)
    assert not has_generator(namesake)
    canonical = training_canonical(namesake)
    assert len(canonical.mesh.vertices) == len(load_category("bottle").canonical.vertices)
