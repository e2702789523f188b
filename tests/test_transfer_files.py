"""What `grasptransfer transfer` reads and writes: poses, meshes, depth pictures, a folder of results."""

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from grasptransfer.drawing.views import look_at
from grasptransfer.errors import ImageError, MeshError, PoseError
from grasptransfer.report import transfer_files
from grasptransfer.report.pose_file import load_pose

POSE = look_at(0.4, 0.6, 0.6)


def test_pose_files_of_ours_and_of_bop_mean_the_same(tmp_path):
    ours, theirs = tmp_path / "ours.yaml", tmp_path / "bop.json"
    ours.write_text(yaml.safe_dump({"camera_from_object": POSE.tolist()}))
    rotation, translation = POSE[:3, :3].ravel().tolist(), (1000 * POSE[:3, 3]).tolist()
    theirs.write_text(yaml.safe_dump({"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": 3}))
    np.testing.assert_allclose(load_pose(ours), POSE, atol=1e-12)
    np.testing.assert_allclose(load_pose(theirs), POSE, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "mapping"),
        ("- 1", "list"),
        ("a: [1", "not valid YAML at line"),
        ("pose: 1", "camera_from_object"),
        ("camera_from_object: [1, 2]", "4 x 4"),
        ("camera_from_object: [[a]]", "numbers"),
        ("cam_R_m2c: [1, 0, 0, 0, 1, 0, 0, 0, 1]", "cam_t_m2c"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,1,600],[0,0,0,1]]", "millimetres"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,-1,0.6],[0,0,0,1]]", "reflection"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,1,0.6],[0,0,0,1]]\ncam_t_m2c: [0,0,0]", "two poses"),
    ],
)
def test_a_wrong_pose_file_is_explained(text, said, tmp_path):
    path = tmp_path / "pose.yaml"
    path.write_text(text)
    with pytest.raises(PoseError) as caught:
        load_pose(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_pose_file_is_named(tmp_path):
    with pytest.raises(PoseError, match="nowhere"):
        load_pose(tmp_path / "nowhere.yaml")


def test_wrong_files_of_the_transfer_command_are_explained(tmp_path):
    grey = tmp_path / "grey.png"
    Image.fromarray(np.zeros((40, 40), np.uint8)).save(grey)
    with pytest.raises(ImageError, match="16-bit"):
        transfer_files.load_depth(grey)
    with pytest.raises(MeshError, match="does not exist"):
        transfer_files.load_mesh(tmp_path / "none.obj")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(MeshError):
        transfer_files.load_mesh(tmp_path / "empty.obj")
    trimesh.creation.box([80, 80, 90]).export(tmp_path / "mm.ply")
    with pytest.raises(MeshError, match="metres"):
        transfer_files.load_mesh(tmp_path / "mm.ply")


def test_depth_pictures_are_millimetres(tmp_path):
    Image.fromarray(np.full((40, 50), 1234, np.uint16)).save(tmp_path / "depth.png")
    np.testing.assert_allclose(transfer_files.load_depth(tmp_path / "depth.png"), 1.234)


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
