import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from grasptransfer.category import load_category
from grasptransfer.errors import GraspFileError, MeshError
from grasptransfer.frames import rigid, transform_points
from grasptransfer.grasping.formats import GraspSet, PlacedGrasp, convert, read_grasps, write_grasps
from grasptransfer.grasping.grasps import Grasp, expand_symmetry, load_grasps, save_grasps
from grasptransfer.grasping.gripper import list_grippers, load_gripper
from grasptransfer.report.execution_table import SimulationSettings, run_simulation
from grasptransfer.simulation import simulate

SUFFIXES = (".yaml", ".h5", ".npy", ".json")
PANDA = load_gripper("panda")


def some_grasps(count=4):
    rng = np.random.default_rng(0)
    grasps = []
    for i in range(count):
        pose = rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
        contacts = transform_points(pose, np.array([[-0.01, 0, 0], [0.01, 0, 0]]))
        grasps.append(
            PlacedGrasp(
                f"grasp_{i}", "rim", pose, 0.02, 0.08, contacts, confidence=float(i % 2), opening=0.05
            )
        )
    return GraspSet(tuple(grasps), object_file="mug.obj", object_scale=0.01)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", list_grippers())
def test_poses_survive_writing_and_reading(tmp_path, suffix, name):
    before = some_grasps()
    path = write_grasps(before, tmp_path / f"g{suffix}", gripper=name)
    after = read_grasps(path, gripper=name)
    for one, other in zip(before.grasps, after.grasps, strict=True):
        np.testing.assert_allclose(one.object_from_gripper, other.object_from_gripper, atol=1e-8)
        assert one.confidence == other.confidence
        if suffix in (".yaml", ".npy"):
            assert other.width == pytest.approx(0.02)
    if suffix != ".npy":
        assert (after.object_file, after.object_scale) == ("mug.obj", 0.01)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_converting_there_and_back_keeps_the_grasps(tmp_path, suffix):
    annotated = [
        Grasp(g.name, g.label, g.object_from_gripper, g.width, contacts=g.contacts, opening=g.opening)
        for g in some_grasps().grasps
    ]
    source = save_grasps(annotated, tmp_path / "a.yaml", category="mug")
    assert convert(source, tmp_path / f"b{suffix}") == 4
    assert convert(tmp_path / f"b{suffix}", tmp_path / "c.yaml") == 4
    for one, other in zip(load_grasps(source), read_grasps(tmp_path / "c.yaml").grasps, strict=True):
        np.testing.assert_allclose(one.canonical_from_gripper, other.object_from_gripper, atol=1e-8)


def test_acronym_has_its_origin_at_the_base_with_our_axes(tmp_path):
    pose = rigid(Rotation.from_euler("x", 180, degrees=True).as_matrix(), np.array([0.0, 0, 0.05]))
    grasp_set = GraspSet((PlacedGrasp("a", "a", pose, 0.02),))
    with h5py.File(write_grasps(grasp_set, tmp_path / "g.h5")) as file:
        written = np.asarray(file["grasps/transforms"])[0]
    # From above: the Panda's base is 103.4 mm over its pads, and closes along the same x.
    np.testing.assert_allclose(written[:3, 3], [0, 0, 0.05 + 0.1034], atol=1e-9)
    np.testing.assert_allclose(written[:3, :3], pose[:3, :3], atol=1e-9)


def test_isaac_poses_of_the_urdf_link_are_turned_to_the_tcp(tmp_path):
    path = tmp_path / "g.yaml"
    grasp = {"confidence": 1.0, "position": [0, 0, 0], "orientation": {"w": 1.0, "xyz": [0, 0, 0]}}
    data = {"format": "isaac_grasp", "format_version": "1.0", "grasps": {"a": grasp}, "created_with": "x"}
    data["gripper_frame_link"] = "/World/Franka/panda_hand"
    path.write_text(yaml.safe_dump(data))
    pose = read_grasps(path).grasps[0].object_from_gripper
    np.testing.assert_allclose(pose, PANDA.base_from_tcp, atol=1e-7)
    np.testing.assert_allclose(pose[:3, 0], [0, 1, 0], atol=1e-7)  # the panda_hand link closes along y
    del data["gripper_frame_link"]  # GraspGen names no frame: the base, but with the TCP's axes
    path.write_text(yaml.safe_dump(data))
    pose = read_grasps(path).grasps[0].object_from_gripper
    np.testing.assert_allclose(pose, rigid(np.eye(3), np.array([0, 0, 0.1034])), atol=1e-7)


def test_isaac_files_hold_the_joints_at_the_grasp_and_on_the_way_in(tmp_path):
    path = write_grasps(some_grasps(), tmp_path / "g.yaml")
    grasp = yaml.safe_load(path.read_text())["grasps"]["grasp_0"]
    assert grasp["cspace_position"]["panda_finger_joint1"] == pytest.approx(0.01)
    assert grasp["pregrasp_cspace_position"]["panda_finger_joint2"] == pytest.approx(0.025)
    assert read_grasps(path).grasps[0].opening == pytest.approx(0.05)


def test_graspnet_rows_have_approach_first_and_tips_at_depth(tmp_path):
    grasp_set = GraspSet((PlacedGrasp("a", "a", np.eye(4), 0.03, confidence=0.7),))
    row = np.load(write_grasps(grasp_set, tmp_path / "g.npy"))[0]
    assert row.shape == (17,)
    np.testing.assert_allclose(row[[0, 1]], [0.7, 0.03])
    rotation = row[4:13].reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 0], [0, 0, 1])  # approach
    np.testing.assert_allclose(rotation[:, 1], [1, 0, 0])  # closing
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert row[3] == pytest.approx(0.009, abs=5e-4)  # the Panda's tips are half a pad past the TCP
    row[3] += 0.02  # another gripper that reaches 2 cm past its grasp centre
    np.save(tmp_path / "deep.npy", row[None])
    pose = read_grasps(tmp_path / "deep.npy").grasps[0].object_from_gripper
    np.testing.assert_allclose(pose[:3, 3], [0, 0, 0.02], atol=1e-9)


def test_graspgen_files_have_the_documented_layout(tmp_path):
    data = json.loads(write_grasps(some_grasps(), tmp_path / "g.json").read_text())
    assert data["gripper"] == {"name": "panda"}
    assert data["object"] == {"file": "mug.obj", "scale": 0.01}
    assert np.array(data["grasps"]["transforms"]).shape == (4, 4, 4)
    assert data["grasps"]["object_in_gripper"] == [False, True, False, True]


def broken(path, what):
    if what == "not h5":
        path.write_text("hello")
    elif what == "empty h5":
        with h5py.File(path, "w") as file:
            file["x"] = 1
    elif what == "17":
        np.save(path, np.zeros((3, 5)))
    elif what == "pickle":
        np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    elif what == "reflection":
        pose = np.diag([1.0, 1, -1, 1]).tolist()
        path.write_text(json.dumps({"grasps": {"transforms": [np.eye(4).tolist(), pose]}}))
    elif what == "millimetres":
        pose = rigid(np.eye(3), np.array([0, 0, 150.0])).tolist()
        path.write_text(json.dumps({"grasps": {"transforms": [pose]}}))
    elif what == "flags":
        data = {"transforms": [np.eye(4).tolist()], "object_in_gripper": [True, False]}
        path.write_text(json.dumps({"grasps": data}))
    elif what == "no json":
        path.write_text("{")
    elif what == "frame":
        path.write_text("format: isaac_grasp\ngripper_frame: thumb\ngrasps: {a: 1}")


@pytest.mark.parametrize(
    ("name", "what", "says"),
    [
        ("g.h5", "not h5", "HDF5"),
        ("g.h5", "empty h5", "grasps/transforms"),
        ("g.npy", "17", "(3, 5)"),
        ("g.npy", "pickle", "npy"),
        ("g.json", "reflection", "grasps.transforms[1]: rotation part is a reflection"),
        ("g.json", "millimetres", "millimetres"),
        ("g.json", "flags", "one flag"),
        ("g.json", "no json", "JSON"),
        ("g.yaml", "frame", "panda_hand"),
        ("g.txt", "", ".npy"),
        ("gone.npy", "", "does not exist"),
    ],
)
def test_a_broken_file_is_named_and_nothing_is_written(tmp_path, name, what, says):
    broken(tmp_path / name, what)
    with pytest.raises(GraspFileError) as caught:
        convert(tmp_path / name, tmp_path / "out.json")
    assert says in str(caught.value)
    assert name in str(caught.value)
    assert not (tmp_path / "out.json").exists()


def test_an_unknown_target_is_refused_before_reading(tmp_path):
    with pytest.raises(GraspFileError, match="suffix"):
        convert(tmp_path / "a.json", tmp_path / "a.csv")


@pytest.mark.parametrize("suffix", [".h5", ".json"])
def test_grasps_of_unknown_width_close_from_fully_open(tmp_path, suffix):
    solid = trimesh.creation.box(extents=(0.04, 0.04, 0.1))
    down = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 0.03]))
    path = write_grasps(GraspSet((PlacedGrasp("top", "box", down, 0.04),)), tmp_path / f"a{suffix}")
    (grasp,) = read_grasps(path).grasps
    assert grasp.width is None
    assert simulate([grasp], solid, PANDA)[0].held


def test_a_category_s_grasp_file_gives_every_member_of_its_families(tmp_path):
    mug = load_category("mug")
    every = expand_symmetry(load_grasps(mug.grasps_path))
    assert [grasp.name for grasp in read_grasps(mug.grasps_path).grasps] == [grasp.name for grasp in every]
    assert convert(mug.grasps_path, tmp_path / "all.yaml") == len(every)


def test_isaac_positions_in_millimetres_are_refused(tmp_path):
    path = write_grasps(
        GraspSet((PlacedGrasp("g", "box", rigid(np.eye(3), np.zeros(3)), 0.04),)), tmp_path / "a.yaml"
    )
    data = yaml.safe_load(path.read_text())
    data["grasps"]["g"]["position"] = [-15.7, 28.8, 30.0]
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(GraspFileError, match=r"a\.yaml.*millimetres"):
        read_grasps(path)


ISAAC = {
    "format": "isaac_grasp",
    "grasps": {"a": {"position": [0, 0, 0.1], "orientation": {"w": 1.0, "xyz": [0, 0, 0]}}},
}


def isaac(folder, **changes):
    path = folder / "foreign.yaml"
    entry = {**ISAAC["grasps"]["a"], **changes.pop("entry", {})}
    path.write_text(yaml.safe_dump({**ISAAC, "grasps": {"a": entry}, **changes}))
    return path


def named_h5(folder, name):
    path = write_grasps(some_grasps(), folder / "named.h5", gripper="wsg50")
    with h5py.File(path, "a") as file:
        del file["gripper/type"]
        file["gripper/type"] = name
    return path


def test_a_file_is_read_for_the_gripper_that_it_names(tmp_path):
    for suffix in (".h5", ".json", ".yaml"):
        path = write_grasps(some_grasps(), tmp_path / f"g{suffix}", gripper="wsg50")
        assert read_grasps(path).gripper.name == "wsg50"
        assert convert(path, tmp_path / "out.h5") == 4
        with h5py.File(tmp_path / "out.h5") as file:
            kind = file["gripper/type"]
            assert isinstance(kind, h5py.Dataset)
            assert kind[()] == b"wsg50"
        for name in ("panda", "robotiq_2f85"):
            with pytest.raises(GraspFileError, match=f"another gripper than {name}.*wsg50"):
                read_grasps(path, gripper=name)
    for name in ("schunk_wsg_50", "WSG-50"):
        assert read_grasps(named_h5(tmp_path, name)).gripper.name == "wsg50"
    with pytest.raises(GraspFileError, match=r"gripper/type.*not known.*barrett.*--gripper"):
        read_grasps(named_h5(tmp_path, "barrett_bh282"))


def test_the_gripper_of_an_isaac_file_is_known_by_its_model_or_its_joints(tmp_path):
    knuckle = load_gripper("robotiq_2f85").finger_joints[0].name
    by_model = isaac(tmp_path, gripper_file="bots/robotiq_2f_85.usd")
    assert read_grasps(by_model).gripper.name == "robotiq_2f85"
    by_joint = isaac(tmp_path, entry={"cspace_position": {knuckle: 0.3}})
    assert read_grasps(by_joint).gripper.name == "robotiq_2f85"
    with pytest.raises(GraspFileError, match=r"not known.*rg2"):
        read_grasps(isaac(tmp_path, gripper_file="bots/onrobot_rg2.usd"))
    with pytest.raises(GraspFileError, match=r"any of several.*robotiq_2f140, robotiq_2f85"):
        read_grasps(isaac(tmp_path, gripper_file="bots/robotiq.usd"))
    other = isaac(tmp_path, entry={"cspace_position": {"finger_joint": 0.3}})
    with pytest.raises(GraspFileError, match=r"joints of another gripper than panda.*panda_finger_joint1"):
        read_grasps(other)
    beyond = isaac(tmp_path, entry={"cspace_position": {"panda_finger_joint1": 0.3}})
    with pytest.raises(GraspFileError, match="beyond what panda moves"):
        read_grasps(beyond)


@pytest.mark.parametrize("scale", [0, -1.0, float("nan"), True, "big", 10**21, 10**400])
def test_an_object_s_scale_must_be_above_zero(tmp_path, scale):
    path = tmp_path / "g.json"
    grasps = {"transforms": [np.eye(4).tolist()]}
    path.write_text(json.dumps({"object": {"file": "a.obj", "scale": scale}, "grasps": grasps}))
    with pytest.raises(GraspFileError, match=r"object\.scale"):
        read_grasps(path)
    if isinstance(scale, float | int) and not isinstance(scale, bool):
        with pytest.raises(GraspFileError, match="object_scale"):
            read_grasps(isaac(tmp_path, object_scale=scale))


def test_the_mesh_of_a_grasp_file_is_scaled_as_the_file_says(tmp_path):
    trimesh.creation.box((0.2, 0.2, 0.4)).export(tmp_path / "box.obj")
    down = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 0.03]))
    grasps = GraspSet((PlacedGrasp("top", "box", down, 0.04),), object_file="box.obj", object_scale=0.2)
    path = write_grasps(grasps, tmp_path / "g.json")
    (trial,) = run_simulation(SimulationSettings(path, tmp_path / "box.obj"))
    assert trial.held
    (trial,) = run_simulation(SimulationSettings(path, tmp_path / "box.obj", scale=0.19))
    assert trial.held
    with pytest.raises(MeshError, match=r"longest side is 0.0008"):
        run_simulation(SimulationSettings(path, tmp_path / "box.obj", scale=0.002))


def test_scores_above_one_keep_their_order(tmp_path):
    rows = np.load(write_grasps(some_grasps(), tmp_path / "g.npy"))
    rows[:, 0] = [0.4, 3.0, 1.2, -0.2]
    np.save(tmp_path / "g.npy", rows)
    scores = [grasp.confidence for grasp in read_grasps(tmp_path / "g.npy").grasps]
    assert np.argsort(scores).tolist() == [3, 0, 2, 1]
    assert min(scores) == 0
    assert max(scores) == 1
    assert read_grasps(isaac(tmp_path, entry={"confidence": 7.5})).grasps[0].confidence == 1


def test_grasps_in_a_camera_s_frame_need_the_object_s_pose(tmp_path):
    before = some_grasps()
    camera_from_object = rigid(
        Rotation.from_euler("xyz", [0.3, 0.5, 2.0]).as_matrix(), np.array([0, 0.1, 0.6])
    )
    seen = tuple(
        replace(grasp, object_from_gripper=camera_from_object @ grasp.object_from_gripper, contacts=None)
        for grasp in before.grasps
    )
    paths = [
        write_grasps(GraspSet(seen, "camera"), tmp_path / f"seen{suffix}") for suffix in (".npy", ".yaml")
    ]
    for path in paths:
        assert read_grasps(path).in_other_frame
        with pytest.raises(GraspFileError, match=r"camera's or the world's frame.*--pose"):
            convert(path, tmp_path / "out.json")
        with pytest.raises(GraspFileError, match=r"camera's or the world's frame.*--pose"):
            run_simulation(SimulationSettings(path, write_box(tmp_path)))
        convert(path, tmp_path / "out.json", camera_from_object=camera_from_object)
        for one, other in zip(before.grasps, read_grasps(tmp_path / "out.json").grasps, strict=True):
            np.testing.assert_allclose(one.object_from_gripper, other.object_from_gripper, atol=1e-8)
    for name, other in (("world", True), ("/World/camera", False), ("camera_optical_frame", True)):
        assert read_grasps(isaac(tmp_path, object_frame_link=name)).in_other_frame == other
    with pytest.raises(GraspFileError, match="is for grasps in a camera"):
        convert(tmp_path / "out.json", tmp_path / "b.json", camera_from_object=camera_from_object)


def write_box(folder):
    trimesh.creation.box((0.04, 0.04, 0.1)).export(folder / "box.obj")
    return folder / "box.obj"


def test_grasps_of_several_objects_are_no_set(tmp_path):
    rows = np.load(write_grasps(some_grasps(), tmp_path / "g.npy"))
    rows[2:, 16] = 7
    np.save(tmp_path / "g.npy", rows)
    with pytest.raises(GraspFileError, match=r"2 objects.*\[0, 7\]"):
        read_grasps(tmp_path / "g.npy")
