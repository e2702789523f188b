"""Training shapes: of whose category they are, and which instances they come from."""

import shutil

import numpy as np
import pytest
import yaml

from grasptransfer.category import Category, load_category
from grasptransfer.files import sha256
from grasptransfer.perception.training_shapes import draw_training_shape, has_generator, training_canonical


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
    shape = draw_training_shape(canonical, np.random.default_rng(0))
    sizes = {len(own.instance_mesh(name).vertices) for name in own.train}
    assert len(shape.vertices) in sizes
    assert shape.latent.shape == (canonical.n_modes,)


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
