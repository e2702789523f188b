"""Rendered training samples: reproducible, completed after a kill, and true."""

import dataclasses
import shutil
import tempfile

import numpy as np
import pytest
from small_training_set import CONFIG, MUG, build_small, rebuilt, small_shards

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.registration import DisplacementModel
from grasptransfer.workshop.training import dataset as dataset_module
from grasptransfer.workshop.training.augmentation import network_input
from grasptransfer.workshop.training.dataset import Dataset, build_dataset
from grasptransfer.workshop.training.samples import render_sample
from grasptransfer.workshop.training.scenes import NO_NOISE
from grasptransfer.workshop.training.training_shapes import draw_training_shape, training_canonical


@pytest.fixture(scope="module", autouse=True)
def four_samples_in_a_shard():
    with small_shards():
        yield


def test_a_data_set_is_reproducible(training_set, tmp_path):
    again = build_small(tmp_path)
    files = sorted(path.relative_to(training_set) for path in training_set.rglob("*.npy"))
    assert len(files) == 11
    for file in files:
        first, second = np.load(training_set / file).astype(float), np.load(again / file).astype(float)
        # The renderer's threads may round a colour one way or the other; nothing else may differ.
        tolerance = 2 if file.name in ("observed.npy", "sprites.npy", "backgrounds.npy") else 0
        np.testing.assert_allclose(first, second, rtol=0, atol=tolerance, err_msg=str(file))


def test_a_complete_data_set_is_not_rendered_again(training_set):
    before = {path: path.stat().st_mtime_ns for path in training_set.rglob("*.npy")}
    build_dataset(CONFIG, training_set.parent, workers=1)
    assert {path: path.stat().st_mtime_ns for path in training_set.rglob("*.npy")} == before


class _LeftBehind:
    """A temporary folder that stays, as a killed run clears nothing up."""

    def __init__(self, prefix, dir):
        self.name = tempfile.mkdtemp(prefix=prefix, dir=dir)

    def __enter__(self):
        return self.name

    def __exit__(self, *_):
        pass


def test_a_data_set_is_completed_after_a_kill_and_its_leftovers_are_removed(tmp_path, monkeypatch):
    target = build_small(tmp_path)
    shutil.rmtree(target / "00000.shard")
    real = np.save

    class Killed(BaseException):
        pass

    def kill(path, array):
        if path.stem == "flow":
            raise Killed
        real(path, array)

    with monkeypatch.context() as patch:
        patch.setattr(np, "save", kill)
        patch.setattr(tempfile, "TemporaryDirectory", _LeftBehind)
        with pytest.raises(Killed):
            dataset_module._write_shard(CONFIG, target, 0)
    leftovers = [path for path in target.iterdir() if path.name.startswith(".")]
    assert leftovers
    build_dataset(CONFIG, tmp_path, workers=0)
    assert len(Dataset(target)) == 4
    assert not any(path.exists() for path in leftovers)


def test_data_of_a_category_that_was_built_again_is_not_used(tmp_path):
    for file in ("canonical.glb", "shape_space.npz", "fields.npz"):
        assert dataclasses.replace(CONFIG, categories=(rebuilt(file),)).digest() != CONFIG.digest()
    moved = dataclasses.replace(MUG, folder=tmp_path)
    assert dataclasses.replace(CONFIG, categories=(moved,)).digest() == CONFIG.digest()


def test_true_motion_of_an_unmoved_canonical_is_zero():
    canonical = training_canonical(MUG)
    rng = np.random.default_rng(0)
    shape = draw_training_shape(canonical, MUG.train, rng)
    rest = canonical.mesh.vertices
    still = dataclasses.replace(
        shape, scene=canonical.mesh, vertices=rest, move=lambda p, f: (p, np.ones(len(p), bool))
    )
    model = DisplacementModel(0 * canonical.model.mean, 0 * canonical.model.basis)
    unmoved = dataclasses.replace(canonical, model=model)
    with Renderer() as renderer:
        sample = render_sample(still, unmoved, rng, renderer=renderer, noise=NO_NOISE)
    assert sample is not None
    assert sample.valid.sum() > 50
    assert (sample.offset[sample.valid] == 0).all()
    # The ray through a pixel's centre returns to it.
    assert np.abs(sample.flow[sample.valid]).max() < 1e-3


def test_the_input_has_eight_channels_and_a_box_that_is_not_given_is_empty():
    observed = np.full((1, 192, 256, 3), 255, np.uint8)
    inputs = network_input(observed, np.full((1, 4), np.nan, np.float32), np.zeros_like(observed))
    assert inputs.shape == (1, 8, 192, 256)
    assert (inputs[:, :3] == 1).all()
    assert (inputs[:, 3:] == -1).all()


def test_the_latent_of_a_training_shape_explains_its_motion():
    canonical = training_canonical(MUG)
    far, left = [], []
    for seed in range(5):
        shape = draw_training_shape(canonical, MUG.train, np.random.default_rng(seed))
        moved, known = _moved_vertices(shape, canonical)
        mean_shape = canonical.vertices(np.zeros(canonical.n_modes))
        far.append(np.linalg.norm((moved - mean_shape)[known], axis=1).mean())
        left.append(np.linalg.norm((moved - canonical.vertices(shape.latent))[known], axis=1).mean())
    assert np.mean(left) < 0.35 * np.mean(far)


def _moved_vertices(shape, canonical):
    faces = canonical.mesh.faces
    face_of = np.zeros(len(canonical.mesh.vertices), int)
    face_of[faces.ravel()] = np.repeat(np.arange(len(faces)), 3)
    return shape.move(np.asarray(canonical.mesh.vertices), face_of)
