"""Fields on disk: the same again, or an error that names the file."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from smooth_fields import cloud, fitted

from grasptransfer.errors import FieldFileError, SettingsError
from grasptransfer.registration import DeformationField, ShapeSpace


def test_a_saved_field_is_the_same(tmp_path):
    field = fitted()
    field.save(tmp_path / "deep" / "field.npz")
    loaded = DeformationField.load(tmp_path / "deep" / "field.npz")
    assert np.array_equal(loaded(cloud(50, 2)), field(cloud(50, 2)))
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["field.npz"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FieldFileError, match=r"nowhere\.npz"):
        DeformationField.load(tmp_path / "nowhere.npz")


def test_a_changed_file_is_refused(tmp_path):
    path = tmp_path / "field.npz"
    fitted().save(path)
    arrays = dict(np.load(path))
    arrays["weights"][3, 1] += 1e-9
    np.savez(path, **arrays)
    with pytest.raises(FieldFileError, match="checksum"):
        DeformationField.load(path)


@settings(max_examples=100)
@given(place=st.floats(0, 1), value=st.integers(1, 255))
def test_a_flipped_byte_never_passes_for_another_field(tmp_path_factory, place, value):
    path = tmp_path_factory.mktemp("flip") / "field.npz"
    field = DeformationField(cloud(20), cloud(20, 1), 1.0, np.zeros(3), 1.0)
    field.save(path)
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - 1))] ^= value
    path.write_bytes(content)
    try:
        loaded = DeformationField.load(path)
    except FieldFileError:
        return
    assert np.array_equal(loaded.weights, field.weights)  # the byte was one that zip does not read


def test_other_files_are_refused(tmp_path):
    (tmp_path / "text.npz").write_text("not a zip")
    np.savez(tmp_path / "plain.npz", weights=np.zeros(3))
    np.savez(tmp_path / "pickled.npz", kind=np.array([{"a": 1}], dtype=object))
    space = ShapeSpace(np.eye(3), 1.0, np.zeros(3), 1.0, np.eye(3), np.zeros((0, 3, 3)), np.zeros(0), 0.0)
    space.save(tmp_path / "space.npz")
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(FieldFileError, match=path.name):
            DeformationField.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "field.npz"
    field = fitted()
    field.save(path)

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(SettingsError, match=r"field\.npz: cannot be written\. disk full"):
        DeformationField.identity(cloud(5)).save(path)
    assert np.array_equal(DeformationField.load(path).weights, field.weights)
    assert [entry.name for entry in tmp_path.iterdir()] == ["field.npz"]
