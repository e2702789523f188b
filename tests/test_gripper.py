import os
import pickle

import numpy as np
import pytest
import trimesh

from grasptransfer.errors import GripperError
from grasptransfer.grasping.frames_table import draw_frames, frames_table
from grasptransfer.grasping.gripper import GRIPPER_FOLDER, list_grippers, load_gripper
from grasptransfer.grasping.parallel_jaw import ParallelJaw

# Hands whose pads slide or stand parallel and mirror each other at the TCP; the others are tested below.
MIRRORED = [name for name in list_grippers() if not load_gripper(name).pads_turn]
PANDA_YAML = (GRIPPER_FOLDER / "panda.yaml").read_text()


def own_copy(folder, old="", new=""):
    (folder / "panda.urdf").write_text((GRIPPER_FOLDER / "panda.urdf").read_text())
    assert old in PANDA_YAML
    path = folder / "mine.yaml"
    path.write_text(PANDA_YAML.replace(old, new, 1))
    return path


@pytest.mark.parametrize("name", MIRRORED)
def test_the_tcp_lies_between_the_pads_which_open_along_x(name):
    gripper = load_gripper(name)
    assert gripper.name == name
    for width in np.linspace(*gripper.opening, 7):
        low, high = gripper.pad_centres(width)
        # The opening curve is interpolated: a linkage errs by a few microns, a slide by none.
        np.testing.assert_allclose(high[0] - low[0], width, atol=2e-5)
        np.testing.assert_allclose((low + high)[:2] / 2, 0, atol=1e-6)
        assert abs(low[2]) < gripper.pads[0].size[1] / 2  # the TCP stays within the pads' height


@pytest.mark.parametrize("name", MIRRORED)
def test_fingers_leave_exactly_the_opening_free_and_point_along_z(name):
    gripper = load_gripper(name)
    for width in (max(0.03, gripper.opening[0]), gripper.max_width):
        meshes = gripper.link_meshes(width)
        tips = [meshes[pad.link] for pad in gripper.pads]
        assert tips[0].bounds[1, 0] == pytest.approx(-width / 2, abs=2e-5)
        assert tips[1].bounds[0, 0] == pytest.approx(width / 2, abs=2e-5)
        base = meshes[gripper.base_link]
        assert base.bounds[1, 2] < min(tip.bounds[0, 2] for tip in tips) + 0.02
        assert max(tip.bounds[1, 2] for tip in tips) == max(m.bounds[1, 2] for m in meshes.values())


@pytest.mark.parametrize("name", MIRRORED)
def test_the_two_fingers_mirror_each_other(name):
    gripper = load_gripper(name)
    meshes = gripper.link_meshes(0.04)
    low, high = (meshes[pad.link].bounds for pad in gripper.pads)
    np.testing.assert_allclose(low[:, 0], -high[::-1, 0], atol=1e-6)
    np.testing.assert_allclose(low[:, 1:], high[:, 1:], atol=1e-6)


def test_the_panda_agrees_with_the_makers_model():
    pybullet_data = pytest.importorskip("pybullet_data")
    folder = os.path.join(pybullet_data.getDataPath(), "franka_panda", "meshes", "collision")
    meshes = load_gripper("panda").link_meshes(0.0)
    finger = trimesh.load_mesh(os.path.join(folder, "finger.obj"))
    ours = meshes["panda_leftfinger"].bounds + np.array([0, 0, 0.045])  # its frame is 45 mm behind the TCP
    theirs = finger.bounds[:, [1, 0, 2]]  # closing along y there, along x here
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], atol=5e-4)
    np.testing.assert_allclose(ours[:, 2], theirs[:, 2], atol=5e-4)
    np.testing.assert_allclose(ours[1, 1], theirs[1, 1], atol=5e-4)
    hand = trimesh.load_mesh(os.path.join(folder, "hand.obj"))
    ours = meshes["panda_hand"].bounds + np.array([0, 0, 0.1034])
    np.testing.assert_allclose(ours[1, [0, 2]], hand.bounds[1, [1, 2]], atol=1e-3)
    np.testing.assert_allclose(ours[1, 1], hand.bounds[1, 0], atol=1e-3)


def test_linked_joints_follow_the_driver_by_their_ratio():
    positions = load_gripper("robotiq_2f85").joint_positions(0.05)
    driver = positions["left_outer_knuckle_joint"]
    assert positions["left_inner_finger_joint"] == -driver
    assert positions["right_outer_knuckle_joint"] == driver


def test_the_2f85_pads_stay_parallel_while_it_closes():
    gripper = load_gripper("robotiq_2f85")
    for width in (0.01, 0.04, 0.085):
        pose = gripper.link_poses(width)["left_inner_finger"]
        reference = gripper.link_poses(0.02)["left_inner_finger"]
        np.testing.assert_allclose(pose[:3, :3], reference[:3, :3], atol=1e-12)


def test_an_opening_out_of_range_is_refused():
    with pytest.raises(GripperError, match=r"between 0 and 0\.08"):
        load_gripper("panda").joint_positions(0.09)


def test_an_unknown_gripper_is_answered_with_the_known_ones():
    with pytest.raises(GripperError) as caught:
        load_gripper("pandora")
    assert caught.value.choices == list_grippers()
    assert {"panda", "robotiq_2f85", "wsg50", "parallel_jaw"} <= set(list_grippers())


def test_a_gripper_of_ones_own_is_read_from_its_yaml(tmp_path):
    gripper = load_gripper(own_copy(tmp_path, "opening: [0, 0.08]", "opening: [0.01, 0.06]"))
    assert gripper.opening == (0.01, 0.06)
    np.testing.assert_allclose(gripper.pad_centres(0.05), load_gripper("panda").pad_centres(0.05))


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("urdf: panda.urdf", "urdf: nowhere.urdf", None, "does not exist"),
        ("base_link: panda_hand", "base_link: hand", "base_link", "panda_leftfinger"),
        ("base_link: panda_hand\n", "", "base_link", "missing"),
        ("force_limit: 70", "force_limit: 0", "force_limit", "positive"),
        ("force_limit: 70", "force: 70", "force_limit", "missing"),
        ("opening: [0, 0.08]", "opening: [0, 80]", "opening", "metres"),
        ("opening: [0, 0.08]", "opening: [0, 0.2]", "opening", "0.0800"),
        ("panda_finger_joint2: {", "joint2: {", "joints.joint2", "panda_finger_joint2"),
        ("{link: panda_rightfinger", "{link: thumb", "pads.0.link", "panda_rightfinger"),
        ("w: 0.70710678", "w: 0.9", "base_from_tcp.orientation", "norm 1"),
        ("[0, 0, 0.1034]", "[0, 0, 0.2]", "base_from_tcp", "97 mm away from the TCP"),
        ("size: [0.0176, 0.018]", "size: [17.6, 18]", "pads.0.size", "millimetres"),
        ("xyz: [0, 0, 0.70710678]", "xyz: [0, 0, -0.70710678]", "pads", "-x pad first"),
    ],
)
def test_a_mistake_in_the_description_is_named(tmp_path, old, new, key, says):
    with pytest.raises(GripperError) as caught:
        load_gripper(own_copy(tmp_path, old, new))
    assert caught.value.key == key
    assert says in str(caught.value)


def test_a_broken_urdf_is_named(tmp_path):
    path = own_copy(tmp_path)
    (tmp_path / "panda.urdf").write_text("<robot name='x'><link")
    with pytest.raises(GripperError, match="URDF"):
        load_gripper(path)


def test_a_parallel_jaw_takes_its_dimensions_from_its_parameters(tmp_path):
    path = ParallelJaw("wide", max_opening=0.16, finger_length=0.09, pad_height=0.03).write(tmp_path)
    gripper = load_gripper(path)
    assert gripper.opening == (0, 0.16)
    tip = gripper.link_meshes(0.1)["finger_high"]
    assert np.ptp(tip.bounds[:, 2]) == pytest.approx(0.09)
    assert tip.bounds[1, 2] == pytest.approx(0.015)  # the TCP is at mid-pad
    with pytest.raises(GripperError, match="finger_length"):
        ParallelJaw(pad_height=1)


def test_the_parallel_jaw_that_comes_along_is_the_default_one(tmp_path):
    ParallelJaw().write(tmp_path)
    for suffix in (".yaml", ".urdf"):
        own, packaged = (folder / f"parallel_jaw{suffix}" for folder in (tmp_path, GRIPPER_FOLDER))
        assert own.read_text() == packaged.read_text()


def test_a_gripper_travels_to_other_processes():
    gripper = load_gripper("panda")
    other = pickle.loads(pickle.dumps(gripper))
    np.testing.assert_array_equal(other.pad_centres(0.03), gripper.pad_centres(0.03))


def test_the_frames_table_names_axes_joints_and_pads(tmp_path):
    gripper = load_gripper("panda")
    table = frames_table(gripper)
    for words in ("0.1034", "closing", "approach", "panda_finger_joint2", "80 mm", "70 N"):
        assert words in table
    picture = draw_frames(gripper, tmp_path / "frames.png")
    assert picture.read_bytes()[:4] == b"\x89PNG"
