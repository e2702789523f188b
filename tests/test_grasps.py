from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from grasptransfer.category import load_category
from grasptransfer.errors import GraspFileError, PoseError
from grasptransfer.frames import rigid, transform_points
from grasptransfer.grasping.grasps import Grasp, Symmetry, expand_symmetry, load_grasps, save_grasps

FILE = """\
format: isaac_grasp
format_version: 1.0
object_frame: canonical
gripper_frame: tcp
grasptransfer: {version: 1, category: mug, length_unit: m, gripper: panda}
grasps:
  rim:
    label: rim
    confidence: 0.9
    position: [0, 0.04, 0.05]
    orientation: {w: 0, xyz: [0.70710678, 0.70710678, 0]}
    width: 0.004
    approach_distance: 0.08
    contacts: [[0, 0.042, 0.05], [0, 0.038, 0.05]]
    symmetry: {axis: [0, 0, 1], degrees: [0, 90, 180]}
"""


@pytest.fixture
def folder(tmp_path):
    return tmp_path


def written(folder, text):
    path = folder / "grasps.yaml"
    path.write_text(text)
    return path


def random_grasp(seed, name):
    rng = np.random.default_rng(seed)
    pose = rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
    half = rng.uniform(0.002, 0.03)
    contacts = transform_points(pose, np.array([[-half, 0, 0], [half, 0, 0]]))
    symmetry = Symmetry(np.array([0, 0, 1.0]), np.zeros(3), samples=5, range_degrees=(-40, 40), flip=True)
    return Grasp(name, "body", pose, 2 * half, 0.07, contacts, symmetry, 0.5, 0.075)


def test_a_file_written_by_hand_is_read_with_its_frames_and_contacts_in_order(folder):
    (grasp,) = load_grasps(written(folder, FILE), category="mug")
    assert (grasp.name, grasp.label, grasp.confidence) == ("rim", "rim", 0.9)
    np.testing.assert_allclose(grasp.canonical_from_gripper[:3, 0], [0, 1, 0], atol=1e-7)
    np.testing.assert_allclose(grasp.canonical_from_gripper[:3, 2], [0, 0, -1], atol=1e-7)
    assert grasp.contacts is not None
    np.testing.assert_allclose(grasp.contacts, [[0, 0.038, 0.05], [0, 0.042, 0.05]])
    assert grasp.symmetry.turns() == (0, 90, 180)


def test_saving_and_loading_gives_the_same_grasps(folder):
    grasps = [random_grasp(seed, f"g{seed}") for seed in range(5)]
    path = save_grasps(grasps, folder / "out.yaml", category="mug", canonical_sha256="ab" * 32)
    for before, after in zip(grasps, load_grasps(path), strict=True):
        # Files keep nanometres.
        np.testing.assert_allclose(before.canonical_from_gripper, after.canonical_from_gripper, atol=1e-8)
        assert before.contacts is not None
        assert after.contacts is not None
        np.testing.assert_allclose(before.contacts, after.contacts, atol=1e-8)
        assert (before.name, before.label, before.approach_distance, before.opening) == (
            after.name,
            after.label,
            after.approach_distance,
            after.opening,
        )
        assert before.symmetry.turns() == pytest.approx(after.symmetry.turns())
    assert [path.name for path in folder.iterdir()] == ["out.yaml"]


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("format: isaac_grasp", "format: acronym", "format", "isaac_grasp"),
        ("object_frame: canonical", "object_frame: camera", "object_frame", "canonical"),
        ("gripper_frame: tcp", "gripper_frame: base", "gripper_frame", "tcp"),
        ("length_unit: m", "length_unit: mm", "grasptransfer.length_unit", "known: m"),
        ("gripper: panda", "gripper: pandora", "grasptransfer.gripper", "panda"),
        ("category: mug, ", "", "grasptransfer.category", "missing"),
        ("version: 1,", "version: 7,", "grasptransfer.version", "known: 1"),
        ("label: rim", "lable: rim", "grasps.rim.lable", "approach_distance"),
        ("w: 0,", "w: 0.5,", "grasps.rim.orientation", "norm 1"),
        ("position: [0, 0.04, 0.05]", "position: [0, 40, 50]", "grasps.rim.position", "millimetres"),
        ("position: [0, 0.04, 0.05]", "position: [0, 0.04]", "grasps.rim.position.2", "missing"),
        ("position: [0, 0.04, 0.05]", "position: [0, .nan, 0]", "grasps.rim.position.1", "finite"),
        ("position: [0, 0.04, 0.05]", "position: [0, high, 0]", "grasps.rim.position.1", "high"),
        ("width: 0.004", "width: 0.2", "grasps.rim.width", "0.08"),
        ("width: 0.004", "width: 0.03", "grasps.rim.width", "0.0040 m apart"),
        ("width: 0.004", "width: -0.01", "grasps.rim.width", "-0.01"),
        ("confidence: 0.9", "confidence: 9", "grasps.rim.confidence", "less than or equal to 1"),
        ("[0, 0.042, 0.05], ", "[0.02, 0.038, 0.05], ", "grasps.rim.contacts", "closing axis"),
        ("axis: [0, 0, 1]", "axis: [0, 0, 0]", "grasps.rim.symmetry.axis", "zero"),
        ("degrees: [0, 90, 180]", "degrees: [0], samples: 3", "grasps.rim.symmetry", "either"),
        ("degrees: [0, 90, 180]", "turns: 3", "grasps.rim.symmetry.turns", "samples"),
        ("    label: rim\n", "    label: rim\n    label: top\n", None, "line 9"),
        ("grasps:\n", "grasps: [\n", None, "line"),
    ],
)
def test_a_mistake_is_named_by_file_key_value_and_choices(folder, old, new, key, says):
    assert FILE.count(old) >= 1
    path = written(folder, FILE.replace(old, new, 1))
    with pytest.raises(GraspFileError) as caught:
        load_grasps(path)
    assert caught.value.path == path
    assert caught.value.key == key
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_grasps_of_another_category_or_model_are_refused(folder):
    path = written(folder, FILE.replace("gripper: panda", "gripper: panda, canonical_sha256: aa"))
    with pytest.raises(GraspFileError, match="another category"):
        load_grasps(path, category="bottle")
    mug: Any = SimpleNamespace(name="mug", canonical_sha256="bb")
    with pytest.raises(GraspFileError, match="another canonical model"):
        load_grasps(path, category=mug)
    mug.canonical_sha256 = "aa"
    assert len(load_grasps(path, category=mug)) == 1


def test_a_missing_file_and_an_empty_one_are_named(folder):
    with pytest.raises(GraspFileError, match="does not exist"):
        load_grasps(folder / "none.yaml")
    with pytest.raises(GraspFileError, match="mapping"):
        load_grasps(written(folder, ""))


def test_reading_never_executes_what_the_file_says(folder):
    with pytest.raises(GraspFileError, match="not valid YAML"):
        load_grasps(written(folder, FILE + "x: !!python/object/apply:os.getcwd []\n"))


def test_a_reflected_pose_is_no_grasp():
    with pytest.raises(PoseError, match="reflection"):
        Grasp("a", "a", np.diag([1.0, 1, -1, 1]), 0.01)


def test_symmetry_turns_pose_and_contacts_together():
    grasp = random_grasp(1, "g")
    local = np.linalg.inv(grasp.canonical_from_gripper)
    assert grasp.contacts is not None
    contacts = transform_points(local, grasp.contacts)
    family = expand_symmetry([grasp])
    assert len(family) == 2 * 5
    assert len({member.name for member in family}) == 10
    for member in family:
        np.testing.assert_allclose(np.linalg.det(member.canonical_from_gripper[:3, :3]), 1)
        assert member.contacts is not None
        inside = transform_points(np.linalg.inv(member.canonical_from_gripper), member.contacts)
        np.testing.assert_allclose(inside, contacts, atol=1e-12)
        assert member.symmetry is None


def test_a_turn_keeps_the_distance_to_its_axis():
    symmetry = Symmetry(np.array([0, 0, 1.0]), np.array([0.01, 0.02, 0]), degrees=(0, 77))
    grasp = Grasp("a", "a", rigid(np.eye(3), np.array([0.05, 0.02, 0.03])), 0.01, symmetry=symmetry)
    position = expand_symmetry([grasp])[1].canonical_from_gripper[:3, 3]
    angle = np.radians(77)
    np.testing.assert_allclose(position, [0.01 + 0.04 * np.cos(angle), 0.02 + 0.04 * np.sin(angle), 0.03])


def test_a_full_circle_of_samples_does_not_repeat_its_start():
    symmetry = Symmetry(np.array([0, 0, 1.0]), np.zeros(3), samples=4)
    assert symmetry.turns() == (0, 90, 180, 270)


def test_flipping_exchanges_the_fingers_and_keeps_the_approach():
    grasp = random_grasp(2, "g")
    plain, flip = expand_symmetry([Grasp("g", "b", grasp.canonical_from_gripper, 0.01)], flip=True)
    relative = plain.canonical_from_gripper.T[:3, :3] @ flip.canonical_from_gripper[:3, :3]
    np.testing.assert_allclose(relative, np.diag([-1, -1, 1]), atol=1e-9)


def test_the_file_is_plain_isaac_grasp_for_other_readers(folder):
    path = save_grasps([random_grasp(3, "g")], folder / "g.yaml", category="mug")
    data = yaml.safe_load(path.read_text())
    assert (data["format"], data["format_version"]) == ("isaac_grasp", 1.0)
    grasp = data["grasps"]["g"]
    norm = np.hypot(grasp["orientation"]["w"], np.linalg.norm(grasp["orientation"]["xyz"]))
    assert len(grasp["position"]) == 3
    assert norm == pytest.approx(1, abs=1e-9)


def test_contacts_that_a_file_leaves_out_are_measured_on_the_canonical_model(tmp_path):
    mug = load_category("mug")
    told = load_grasps(mug.grasps_path, category=mug)
    data = yaml.safe_load(mug.grasps_path.read_text())
    for entry in data["grasps"].values():
        entry.pop("contacts", None)
        entry.pop("width", None)
    path = tmp_path / "grasps.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    assert all(grasp.width is None for grasp in load_grasps(path))
    measured = {grasp.name: grasp for grasp in load_grasps(path, category=mug)}
    for grasp in told:
        assert measured[grasp.name].width == pytest.approx(grasp.width, abs=0.002)
        assert np.linalg.norm(measured[grasp.name].contacts - grasp.contacts, axis=1).max() < 0.01
    data["grasps"][told[0].name]["position"] = [0.0, 0.0, 0.5]
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(GraspFileError, match="meet nothing"):
        load_grasps(path, category=mug)


def test_turns_that_share_a_name_are_refused():
    symmetry = Symmetry(np.array([0, 0, 1.0]), np.zeros(3), degrees=(0, 360))
    with pytest.raises(GraspFileError, match="share a name"):
        expand_symmetry([Grasp("g", "g", np.eye(4), 0.02, symmetry=symmetry)])


POSITION, ORIENTATION = "position: [0, 0.04, 0.05]", "orientation: {w: 0, xyz: [0.70710678, 0.70710678, 0]}"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (ORIENTATION, "orientation: [0, 1, 0, 0]", "Write it as {w: 1, xyz: [0, 0, 0]}"),
        (ORIENTATION, "orientation: {x: 1, y: 0, z: 0, w: 0}", "Write it as {w: 1, xyz: [0, 0, 0]}"),
        (POSITION, "position: {x: 0, y: 0, z: 0}", "Write it as [0, 0, 0]"),
        (POSITION, "position: [0, 0, 0,05]", "[0, 0, 0], with points in decimals"),
        (POSITION, "position: [0, 0, yes]", "must be a number (got 'yes')"),
        (POSITION, "position: [0, 0, true]", "must be a number (got True)"),
        (POSITION, "position: [0, 0, '0.05']", "must be a number (got '0.05')"),
        ("width: 0.004", "width: thin", "must be a number (got 'thin')"),
        ("label: rim", "label: 12", "must be text"),
        ("degrees: [0, 90, 180]", "samples: 2.5", "must be a whole number"),
        ("axis: [0, 0, 1]", "flip: 1, axis: [0, 0, 1]", "must be true or false"),
        (
            POSITION,
            "transform: [[1, 0, 0, 0]]",
            "transform is not a known key. Write it as {position: [0, 0, 0]",
        ),
        ("    label", "    - label", "not valid YAML"),
    ],
)
def test_a_value_of_the_wrong_form_is_answered_with_the_right_one(folder, old, new, says):
    with pytest.raises(GraspFileError) as caught:
        load_grasps(written(folder, FILE.replace(old, new, 1)))
    text = str(caught.value)
    assert says in text
    for inner in ("Model", "instance", "tuple", "dictionary", "[key]", "Input"):
        assert inner not in text.replace(str(folder), "")


@pytest.mark.parametrize("entries", ["[{position: [0, 0, 0]}]", "{rim: }", "top"])
def test_grasps_of_the_wrong_form_are_answered_with_the_right_one(folder, entries):
    with pytest.raises(GraspFileError, match=r"Write it as \{.*position: \[0, 0, 0.*orientation: \{w: 1"):
        load_grasps(written(folder, FILE.split("grasps:")[0] + f"grasps: {entries}"))


def test_merge_keys_and_any_name_will_do(folder):
    text = FILE.replace("  rim:", "  rim: &rim").replace("    label: rim\n", "")
    text += "  no: {<<: *rim, confidence: 0.5}\n  1: {<<: *rim}\n"
    grasps = load_grasps(written(folder, text))
    assert [(grasp.name, grasp.confidence) for grasp in grasps] == [("rim", 0.9), ("no", 0.5), ("1", 0.9)]
    again = save_grasps(grasps, folder / "again.yaml", category="mug")
    assert [grasp.name for grasp in load_grasps(again)] == ["rim", "no", "1"]


@pytest.mark.parametrize("label", ["1e3", "no", "12", "2026-01-01", "0x1f", "a: b"])
def test_any_label_survives_writing_and_reading(folder, label):
    grasp = replace(random_grasp(4, label), label=label)
    (read,) = load_grasps(save_grasps([grasp], folder / "g.yaml", category="mug"))
    assert (read.name, read.label) == (label, label)
