"""Pose files of people, estimators and robots mean the same pose; a wrong one is refused with the reason."""

import json
import logging

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import PoseError
from grasptransfer.frames import OPENGL_FROM_OPENCV, drift, invert, moved, rigid
from grasptransfer.poses import check_in_view, covariance_of, load_pose, pose_as_yaml, read_pose

POSE = look_at(0.4, 0.6, 0.6)
LOW = look_at(0.4, -2.0, 0.1)
CAMERA = Camera.from_fov(640, 480, 1.0)
QUATERNION = Rotation.from_matrix(POSE[:3, :3]).as_quat().tolist()
BOP = {"cam_R_m2c": POSE[:3, :3].ravel().tolist(), "cam_t_m2c": (1000 * POSE[:3, 3]).tolist(), "obj_id": 3}
ROS = {
    "position": dict(zip("xyz", POSE[:3, 3].tolist(), strict=True)),
    "orientation": dict(zip("xyzw", QUATERNION, strict=True)),
}
FRAME = {"file_path": "./a/one.png", "transform_matrix": (invert(POSE) @ OPENGL_FROM_OPENCV).tolist()}
SAME = {
    "text.txt": "\n".join(" ".join(f"{value:.18e}" for value in row) for row in POSE) + "\n",
    "three_rows.txt": "\n".join(", ".join(map(str, row)) for row in POSE[:3].tolist()),
    "one_row.txt": "# made by np.savetxt\n" + " ".join(map(str, POSE.ravel().tolist())),
    "rows.json": json.dumps(POSE.tolist()),
    "tabs.json": json.dumps({"camera_from_object": POSE.tolist()}, indent="\t"),
    "exponents.yaml": "camera_from_object:\n"
    + "\n".join("- [" + ", ".join(f"{value:.16e}" for value in row) + "]" for row in POSE),
    "inverse.yaml": yaml.safe_dump({"object_from_camera": invert(POSE).tolist()}),
    "entry.json": json.dumps(BOP),
    "list.json": json.dumps([BOP]),
    "scene_gt.json": json.dumps({"7": [BOP]}),
    "pose.yaml": yaml.safe_dump(ROS),
    "stamped.yaml": yaml.safe_dump({"header": {"frame_id": "cam_color_optical_frame"}, "pose": ROS})
    + "---\n",
    "with_covariance.yaml": yaml.safe_dump({"pose": {"pose": ROS, "covariance": [0.0] * 36}}),
    "transform.yaml": yaml.safe_dump(
        {"transform": {"translation": ROS["position"], "rotation": ROS["orientation"]}}
    ),
    "object_data.json": json.dumps([{"label": "mug", "TWO": [QUATERNION, POSE[:3, 3].tolist()]}]),
    "transforms.json": json.dumps({"camera_angle_x": 0.7, "frames": [FRAME]}),
}


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", SAME)
def test_every_format_gives_the_same_pose_and_says_what_was_read(name, tmp_path, caplog):
    path = written(tmp_path, name, SAME[name])
    with caplog.at_level(logging.WARNING):
        found = read_pose(path)
    np.testing.assert_allclose(found.camera_from_object, POSE, atol=1e-9)
    assert found.pose_sigma is None
    own = found.convention.startswith("our")
    assert own == (name in ("tabs.json", "exponents.yaml"))
    assert own or found.convention in caplog.text


def test_a_numpy_file_is_read(tmp_path):
    np.save(tmp_path / "pose.npy", POSE.astype(np.float32))
    np.testing.assert_allclose(load_pose(tmp_path / "pose.npy"), POSE, atol=1e-6)


def test_the_name_of_the_picture_selects_its_entry(tmp_path):
    other = BOP | {"cam_t_m2c": [0.0, 0.0, 900.0]}
    path = written(tmp_path, "scene_gt.json", json.dumps({"3": [other], "12": [BOP]}))
    np.testing.assert_allclose(load_pose(path, image="rgb/000012.png"), POSE, atol=1e-9)
    with pytest.raises(PoseError, match=r"000003\.png, 000012\.png"):
        load_pose(path)
    frames = {"frames": [FRAME, FRAME | {"file_path": "a/two"}]}
    path = written(tmp_path, "transforms.json", json.dumps(frames))
    np.testing.assert_allclose(load_pose(path, image="two.png"), POSE, atol=1e-9)
    with pytest.raises(PoseError, match="one, two"):
        load_pose(path, image="three.png")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "mapping"),
        ("- 1", "mapping"),
        ("a: [1", "not valid YAML at line"),
        ("pose: 1", "camera_from_object"),
        ("1 2 3", "4x4"),
        ("1 0 0 0\n0 1 0", "rows of different lengths"),
        ("[[1, 0], [0]]", "numbers"),
        ("a: 1\n---\nb: 2", "2 documents"),
        ("camera_from_object: [1, 2]", "4 x 4"),
        ("camera_from_object: [[1,0,0,true],[0,1,0,0],[0,0,1,0.6],[0,0,0,1]]\npose_sigma: -1", "uncertainty"),
        ("cam_R_m2c: [1, 0, 0, 0, 1, 0, 0, 0, 1]\ncam_t_m2c: [0.019, 0.017, 0.507]", "looks like metres"),
        ("position: {x: 0, y: 0, z: 1}\norientation: {x: 0, y: 0, z: 0, w: 2}", "length 1"),
        ("position: {x: 0, y: 0}\norientation: {x: 0, y: 0, z: 0, w: 1}", "position.z"),
        ("{header: {frame_id: base_link}, pose: {position: {}, orientation: {}}}", "optical frame"),
        ("{TWO: [[0, 0, 0, 1]]}", "TWO"),
        ("[{obj_id: 1}, {obj_id: 5}]", "2 entries"),
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


def test_the_uncertainty_of_a_pose_file_is_read_and_written(tmp_path):
    for sigma in (0, (0.01, 5.0), np.diag(np.arange(1.0, 7.0)) * 1e-4):
        path = written(tmp_path, "pose.yaml", yaml.safe_dump(pose_as_yaml(POSE, sigma)))
        found = read_pose(path)
        read, written_as = covariance_of(found.pose_sigma), covariance_of(sigma)
        assert read is not None
        assert written_as is not None
        np.testing.assert_allclose(read, written_as, atol=1e-12)
        np.testing.assert_allclose(found.camera_from_object, POSE, atol=1e-12)


def test_the_covariance_of_ros_is_put_in_our_order(tmp_path):
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-4  # x, y, z, about x, about y, about z
    path = written(
        tmp_path,
        "pose.yaml",
        yaml.safe_dump({"pose": {"pose": ROS, "covariance": covariance.ravel().tolist()}}),
    )
    sigma = read_pose(path).pose_sigma
    assert isinstance(sigma, np.ndarray)
    np.testing.assert_allclose(np.diag(sigma), np.array([4, 5, 6, 1, 2, 3]) * 1e-4)


@given(st.floats(1e-6, 0.5), st.floats(1e-6, 90))
def test_standard_deviations_become_a_covariance_of_the_drift_of_a_pose(translation, degrees):
    covariance = covariance_of((translation, degrees))
    assert covariance is not None
    step = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(step[3:], translation)
    np.testing.assert_allclose(np.degrees(step[:3]), degrees)
    small = step / 20
    np.testing.assert_allclose(drift(POSE, moved(POSE, small)), small, atol=1e-9)


@pytest.mark.parametrize(
    ("sigma", "said"),
    [
        (1, "known: 0"),
        ("wide", "known: 0"),
        ((1, 2, 3), "known: 0"),
        ((np.nan, 1), "known: 0"),
        ((-0.01, 5), "at least 0"),
        ((10.0, 5), "millimetres"),
        (np.triu(np.ones((6, 6))), "symmetric"),
        (-np.eye(6), "negative"),
    ],
)
def test_what_is_no_uncertainty_is_refused(sigma, said):
    with pytest.raises(PoseError, match=said):
        covariance_of(sigma)


def test_without_uncertainty_there_is_no_covariance():
    assert covariance_of(None) is None
    assert not covariance_of(0).any()


@pytest.mark.parametrize(
    ("given_pose", "hint"),
    [
        (invert(LOW), "object_from_camera"),
        (OPENGL_FROM_OPENCV @ POSE, "OpenGL"),
        (invert(POSE) @ OPENGL_FROM_OPENCV, "object_from_camera in OpenGL"),
        (rigid(POSE[:3, :3], POSE[:3, 3] / 1000), "divided by 1000"),
    ],
)
def test_a_pose_out_of_view_gets_the_convention_that_would_put_it_in_view(given_pose, hint):
    with pytest.raises(PoseError, match=hint):
        check_in_view(given_pose, CAMERA)
    check_in_view(POSE, CAMERA)
    check_in_view(LOW, CAMERA)
