"""What `grasptransfer transfer` reads and writes: poses, meshes, depth pictures, a folder of results."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from grasptransfer.drawing.views import look_at
from grasptransfer.errors import ImageError, MeshError
from grasptransfer.meshes import load_mesh
from grasptransfer.report import transfer_files, transfer_inputs

POSE = look_at(0.4, 0.6, 0.6)


def test_wrong_files_of_the_transfer_command_are_explained(tmp_path):
    grey = tmp_path / "grey.png"
    Image.fromarray(np.zeros((40, 40), np.uint8)).save(grey)
    with pytest.raises(ImageError, match="16-bit"):
        transfer_inputs.load_depth(grey)
    with pytest.raises(MeshError, match="does not exist"):
        load_mesh(tmp_path / "none.obj")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(MeshError):
        load_mesh(tmp_path / "empty.obj")
    trimesh.creation.box([80, 80, 90]).export(tmp_path / "mm.ply")
    with pytest.raises(MeshError, match="metres"):
        load_mesh(tmp_path / "mm.ply")


def test_depth_pictures_are_millimetres(tmp_path):
    Image.fromarray(np.full((40, 50), 1234, np.uint16)).save(tmp_path / "depth.png")
    np.testing.assert_allclose(transfer_inputs.load_depth(tmp_path / "depth.png"), 1.234)


def test_files_appear_all_together_or_not_at_all(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("stays")
    with pytest.raises(RuntimeError), transfer_files.replacing_files(out) as folder:  # noqa: PT012
        (folder / "half.txt").write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
    with transfer_files.replacing_files(out) as folder:
        (folder / "whole.txt").write_text("whole")
    assert sorted(path.name for path in out.iterdir()) == ["mine.txt", "whole.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
