"""URDFs and YAML files of grippers as laboratories have them: right, or refused with the reason."""

import logging

import numpy as np
import pytest
import trimesh
from gripper_files import FINGERS, PALM, box, joint, link, mimic, write_gripper

from grasptransfer.errors import GripperError
from grasptransfer.grasping import CheckStatus, check_grasps, on_canonical
from grasptransfer.grasping.closing import close_pads
from grasptransfer.grasping.grasps import Grasp
from grasptransfer.grasping.gripper import load_gripper
from grasptransfer.grasping.surface import Surface

RIGHT_ALONE = joint("right_slide", "palm", "right", axis="0 -1 0")


def refused(path):
    with pytest.raises(GripperError) as caught:
        load_gripper(path)
    return str(caught.value)


def top_grasps(gripper, width, count=1):
    """Grasps of a box from above, closing along its x, the box's middle between the opened pads."""
    opening = gripper.approach_opening(width)
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1, -1])
    pose[0, 3] = -float(gripper.pad_middle(np.array([opening]))[0])
    pose[2, 3] = 0.045 + gripper.pad_faces(np.array([width])).across[0, :, 1].mean()
    return [Grasp(f"top {i}", "box", pose, width) for i in range(count)]


def a_box(width):
    return trimesh.creation.box(extents=(width, 0.04, 0.1))


# What moves with what


def test_mimic_joints_need_not_be_repeated_in_the_yaml(tmp_path):
    gripper = load_gripper(write_gripper(tmp_path))
    assert gripper.joint_positions(0.03) == pytest.approx({"left_slide": 0.015, "right_slide": 0.015})
    given = [("opening:", "joints: {right_slide: {ratio: 1}}\nopening:")]
    assert load_gripper(write_gripper(tmp_path, replace=given)).finger_joints[0].name == "right_slide"


def test_ratio_and_offset_come_from_mimic_through_a_chain(tmp_path):
    last, between = mimic("middle", 2, 0.001), mimic("left_slide", -0.5, -0.0005)
    right = joint("right_slide", "palm", "right", axis="0 1 0", limits=(-0.03, 0), more=last)
    middle = joint("middle", "palm", "weight", axis="0 0 1", limits=(-0.02, 0.02), more=between)
    weight = link("weight", box((0.01, 0.01, 0.01), (0, 0, -0.1)))
    gripper = load_gripper(write_gripper(tmp_path, right=right, more=weight + middle))
    positions = gripper.joint_positions(0.04)
    assert positions["left_slide"] == pytest.approx(0.02)
    assert positions["middle"] == pytest.approx(-0.0105)
    assert positions["right_slide"] == pytest.approx(-0.02)


@pytest.mark.parametrize("entry", ["{ratio: -1}", "{offset: 0.01}"])
def test_a_yaml_that_contradicts_mimic_is_refused_with_both_numbers(tmp_path, entry):
    given = [("opening:", f"joints: {{left_slide: {{ratio: 1}}, right_slide: {entry}}}\nopening:")]
    message = refused(write_gripper(tmp_path, replace=given))
    assert "joints.right_slide" in message
    assert "gives ratio 1 and offset 0" in message


def test_a_joint_whose_motion_nothing_tells_must_be_listed(tmp_path):
    message = refused(write_gripper(tmp_path, right=RIGHT_ALONE))
    assert "must be listed" in message
    assert "A ratio of 0" in message


def test_mimic_that_goes_round_in_a_circle_is_named(tmp_path):
    left = joint("left_slide", "palm", "left", more=mimic("right_slide"))
    assert "circle" in refused(write_gripper(tmp_path, left=left))


def test_a_joint_of_ratio_0_stands_still_at_its_offset(tmp_path):
    propeller = link("propeller", box((0.02, 0.02, 0.002))) + joint(
        "spin", "palm", "propeller", kind="continuous", axis="0 0 1", at="0 0 0.055", limits=None
    )
    given = [("opening:", "joints: {left_slide: {ratio: 1}, spin: {ratio: 0, offset: 0.5}}\nopening:")]
    gripper = load_gripper(write_gripper(tmp_path, more=propeller, replace=given))
    assert gripper.joint_positions(0.01)["spin"] == gripper.joint_positions(0.05)["spin"] == 0.5


def test_mimic_of_a_joint_elsewhere_is_told_where_the_motion_is_missing(tmp_path):
    right = joint("right_slide", "palm", "right", axis="0 -1 0", more=mimic("arm_joint"))
    message = refused(write_gripper(tmp_path, right=right))
    assert "right_slide: moves below the base link and must be listed" in message
    assert "It follows arm_joint, which does not move below the base link" in message


# Limits


def test_a_follower_whose_limits_are_too_narrow_is_refused_with_the_needed_range(tmp_path):
    right = joint("right_slide", "palm", "right", axis="0 -1 0", limits=(0, 0.001), more=mimic("left_slide"))
    message = refused(write_gripper(tmp_path, right=right))
    assert "right_slide" in message
    assert "from 0 to 0.025" in message
    assert "[0.0, 0.001]" in message


def test_limits_of_a_follower_without_their_sign_are_taken_with_it(tmp_path, caplog):
    follows = mimic("left_slide", -1)
    right = joint("right_slide", "palm", "right", axis="0 1 0", limits=(0, 0.03), more=follows)
    with caplog.at_level(logging.WARNING):
        gripper = load_gripper(write_gripper(tmp_path, right=right))
    assert gripper.finger_joints[1].limits == (-0.03, 0)
    assert "right_slide" in caplog.text


def test_a_follower_that_the_wanted_stretch_does_not_ask_too_much_of_is_fine(tmp_path):
    right = joint("right_slide", "palm", "right", axis="0 -1 0", limits=(0, 0.021), more=mimic("left_slide"))
    narrower = [("opening: [0, 0.05]", "opening: [0, 0.04]")]
    assert load_gripper(write_gripper(tmp_path, right=right, replace=narrower)).max_width == 0.04


# Crashes and files


@pytest.mark.parametrize("axis", ["0 0 0", "nan 0 1"])
def test_an_axis_without_length_is_refused(tmp_path, axis):
    message = refused(write_gripper(tmp_path, left=joint("left_slide", "palm", "left", axis=axis)))
    assert "left_slide: its axis has no length" in message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('lower="0"', 'lower="-1e308"', "must lie within 10 m"),
        ('<origin xyz="', '<origin xyz="1e21', "must be finite and within 10 m"),
        ('<box size="', '<box size="0.01 ', "a box needs three lengths"),
    ],
)
def test_numbers_that_no_hand_has_are_refused(tmp_path, old, new, said):
    path = write_gripper(tmp_path)
    urdf = next(tmp_path.rglob("*.urdf"))
    text = urdf.read_text()
    assert old in text
    urdf.write_text(text.replace(old, new, 1))
    assert said in refused(path)


def test_a_xacro_file_is_to_be_expanded_first(tmp_path):
    path = write_gripper(tmp_path, more='<xacro:finger xmlns:xacro="http://ros.org/wiki/xacro" side="1"/>')
    assert "Expand it first: xacro own.urdf" in refused(path)


@pytest.mark.parametrize(("root", "kind"), [("sdf", "SDF"), ("mujoco", "MJCF")])
def test_another_description_of_robots_is_named(tmp_path, root, kind):
    path = write_gripper(tmp_path)
    (tmp_path / "own.urdf").write_text(f'<?xml version="1.0"?><!-- <robot> --><{root} version="1"></{root}>')
    assert f"is a {kind} file, not a URDF" in refused(path)


@pytest.mark.parametrize("mass", ["nan", "-1"])
def test_a_mass_that_no_body_has_is_refused(tmp_path, mass):
    moments = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    palm = PALM.replace("<collision>", f'<inertial><mass value="{mass}"/>{moments}</inertial><collision>', 1)
    assert "palm: its mass and moments of inertia must be finite" in refused(
        write_gripper(tmp_path, palm=palm)
    )


def test_a_link_with_two_parents_is_named(tmp_path):
    message = refused(write_gripper(tmp_path, more=joint("again", "left", "right")))
    assert "its child right has two parents" in message


PACKAGE_MESH = (
    '<collision><geometry><mesh filename="package://hands/meshes/palm.obj" scale="0.001 0.001 0.001"/>'
    "</geometry></collision>"
)


@pytest.mark.parametrize(
    ("package", "urdf_folder"),
    [("hands", "hands/grippers/two/urdf"), ("hands", "bringup/urdf"), ("clone", "clone/urdf")],
)
def test_a_package_is_found_above_the_urdf_or_beside_its_own(tmp_path, package, urdf_folder):
    folder, meshes = tmp_path / urdf_folder, tmp_path / package / "meshes"
    for each in (folder, meshes):
        each.mkdir(parents=True)
    (tmp_path / package / "package.xml").write_text("<package><name>hands</name></package>")
    trimesh.creation.box(extents=(40, 90, 50)).export(meshes / "palm.obj")
    gripper = load_gripper(write_gripper(folder, palm=link("palm", PACKAGE_MESH)))
    np.testing.assert_allclose(gripper.links[0].collision.extents, [0.04, 0.09, 0.05], atol=1e-9)


def test_a_mesh_that_is_nowhere_is_answered_with_where_it_was_looked_for(tmp_path):
    message = refused(write_gripper(tmp_path, palm=link("palm", PACKAGE_MESH)))
    assert "package://hands/meshes/palm.obj not found" in message
    assert str(tmp_path.parent / "hands" / "meshes" / "palm.obj") in message


def test_a_mesh_in_millimetres_is_named(tmp_path):
    trimesh.creation.box(extents=(40, 90, 50)).export(tmp_path / "palm.obj")
    palm = link("palm", '<collision><geometry><mesh filename="palm.obj"/></geometry></collision>')
    assert "looks like millimetres" in refused(write_gripper(tmp_path, palm=palm))


# What is solid


def test_a_link_that_is_only_drawn_collides_with_nothing_unless_asked(tmp_path):
    marker = link("marker", box((0.01, 0.01, 0.01), tag="visual")) + joint(
        "mark", "palm", "marker", kind="fixed", at="0 0 0.12"
    )
    gripper = load_gripper(write_gripper(tmp_path, more=marker))
    assert "marker" in gripper.link_meshes(0.05, visual=True)
    assert "marker" not in gripper.link_meshes(0.05)
    asked = [("opening:", "solid_visuals: [marker]\nopening:")]
    assert "marker" in load_gripper(write_gripper(tmp_path, more=marker, replace=asked)).link_meshes(0.05)


def test_a_pad_on_a_link_that_nothing_can_touch_is_refused(tmp_path):
    drawn = {name: text.replace("collision", "visual") for name, text in FINGERS.items()}
    message = refused(write_gripper(tmp_path, fingers=drawn))
    assert "solid_visuals: [right]" in message


def test_a_link_that_blocks_every_grasp_is_named_and_can_be_ignored(tmp_path):
    hull = link("palm", box((0.04, 0.09, 0.05), (0, 0, 0.025)), box((0.08, 0.12, 0.13), (0, 0, 0.06)))
    gripper = load_gripper(write_gripper(tmp_path, palm=hull))
    checks = check_grasps(on_canonical(top_grasps(gripper, 0.03, count=2)), a_box(0.03), gripper)
    assert {check.link for check in checks} == {"palm"}
    assert "ignore_links: [palm]" in checks[0].reason
    ignored = [("opening:", "ignore_links: [palm]\nopening:")]
    gripper = load_gripper(write_gripper(tmp_path, palm=hull, replace=ignored))
    checks = check_grasps(on_canonical(top_grasps(gripper, 0.03, count=2)), a_box(0.03), gripper)
    assert all(check.usable for check in checks)


@pytest.mark.parametrize("key", ["ignore_links", "solid_visuals"])
def test_an_unknown_link_in_the_yaml_is_answered_with_the_known_ones(tmp_path, key):
    message = refused(write_gripper(tmp_path, replace=[("opening:", f"{key}: [thumb]\nopening:")]))
    assert key in message
    assert "known: palm, left, right" in message


# Where the pads are


def test_pads_on_the_outer_face_of_their_fingers_are_noticed(tmp_path):
    outside = [
        ("right, centre: [0, 0,", "right, centre: [0, -0.006,"),
        ("left, centre: [0, 0,", "left, centre: [0, 0.006,"),
        ("opening: [0, 0.05]", "opening: [0.012, 0.062]"),
    ]
    assert "6.0 mm of the finger stand out before this pad" in refused(
        write_gripper(tmp_path, replace=outside)
    )


def test_pads_before_their_fingers_are_noticed(tmp_path):
    away = [("right, centre: [0, 0,", "right, centre: [0, 0.01,")]
    message = refused(write_gripper(tmp_path, replace=[*away, ("opening: [0, 0.05]", "opening: [0, 0.04]")]))
    assert "pads.0" in message
    assert "by 10.0 mm" in message


def test_pads_that_miss_each_other_are_refused_with_by_how_much(tmp_path):
    lower = [("left, centre: [0, 0, 0.07]", "left, centre: [0, 0, 0.03]")]
    assert "miss each other by 40 mm along TCP z" in refused(write_gripper(tmp_path, replace=lower))


def test_an_approach_that_points_into_the_palm_is_refused(tmp_path):
    reversed_ = [("{w: 0.70710678, xyz: [0, 0, 0.70710678]}", "{w: 0, xyz: [0.70710678, 0.70710678, 0]}")]
    assert "beyond the pads along TCP z" in refused(write_gripper(tmp_path, replace=reversed_))


def one_jaw(folder):
    """The right jaw stands 2 cm beside the palm's axis; the left one slides away from it."""
    return write_gripper(
        folder,
        left=joint("left_slide", "palm", "left", limits=(0, 0.05)),
        right=joint("right_mount", "palm", "right", kind="fixed", at="0 0 0"),
        fingers={**FINGERS, "right": link("right", box((0.01, 0.006, 0.08), (0, -0.023, 0.09)))},
        replace=[
            ("right, centre: [0, 0, 0.07]", "right, centre: [0, -0.02, 0.12]"),
            ("[0, 0.05]", "[0.02, 0.07]"),
        ],
    )


def test_one_jaw_that_stands_is_planned_with_where_it_is(tmp_path):
    gripper = load_gripper(one_jaw(tmp_path))
    np.testing.assert_allclose(gripper.pad_centres(0.03)[:, 0], [-0.02, 0.01], atol=1e-9)
    np.testing.assert_allclose(gripper.pad_centres(0.07)[:, 0], [-0.02, 0.05], atol=1e-9)
    beside = a_box(0.03)
    beside.apply_translation([-0.005, 0, 0])  # against the jaw that stands
    meets = close_pads(Surface(beside), np.eye(4)[None], np.array([0.07]), gripper)
    assert meets.touching.all()
    assert not meets.buried.any()
    assert meets.width[0] == pytest.approx(0.03, abs=1e-6)
    for gap in (1e-9, -1e-9):  # whatever rounding makes of standing against the jaw
        against = a_box(0.03)
        against.apply_translation([-0.005 + gap, 0, 0])
        meets = close_pads(Surface(against), np.eye(4)[None], np.array([0.07]), gripper)
        assert not meets.buried.any()
        assert meets.width[0] == pytest.approx(0.03, abs=1e-6)
    cut = close_pads(Surface(a_box(0.06)), np.eye(4)[None], np.array([0.07]), gripper)
    assert cut.buried[0].tolist() == [True, False]


def turning(folder, opening="[0.01, 0.05]", normal=""):
    """The left jaw turns about a hinge 7 cm behind its pad and is parallel to the other at 10 mm."""
    hinge = {"kind": "revolute", "axis": "-1 0 0", "at": "0 0.005 0.05", "limits": (-0.05, 2)}
    return write_gripper(
        folder,
        left=joint("left_hinge", "palm", "left", **hinge),
        right=joint("right_mount", "palm", "right", kind="fixed", at="0 -0.005 0.05"),
        replace=[
            ("[0, 0.05]", opening),
            ("left, centre: [0, 0, 0.07]", f"left, centre: [0, 0, 0.07]{normal}"),
        ],
    )


def test_jaws_that_turn_are_accepted_where_only_the_wanted_stretch_rises(tmp_path):
    gripper = load_gripper(turning(tmp_path))
    assert gripper.opening == pytest.approx((0.01, 0.05), abs=1e-6)
    faces = gripper.pad_faces(np.array([0.01, 0.05]))
    np.testing.assert_allclose(faces.normals[0], [[1, 0, 0], [-1, 0, 0]], atol=1e-3)
    turned = np.degrees(np.arccos(-faces.normals[1, 1, 0]))
    assert turned == pytest.approx(np.degrees(np.arcsin(0.04 / 0.07)), abs=0.1)


def test_a_tilted_pad_touches_with_its_edge_first(tmp_path):
    gripper = load_gripper(turning(tmp_path))
    box = trimesh.creation.box(extents=(0.03, 0.04, 0.2))
    box.apply_translation([0.011, 0, 0])  # one face 1 mm before the jaw that stands
    meets = close_pads(Surface(box), np.eye(4)[None], np.array([0.05]), gripper, expected=np.array([0.03]))
    assert meets.width[0] == pytest.approx(0.03, abs=1e-5)
    # The jaw opens like scissors: what is nearer to the hinge touches, with a fifth of the pad.
    assert meets.opening[0] > 0.032
    assert meets.coverage[0].tolist() == pytest.approx([1.0, 0.2])
    assert np.degrees(np.arccos(meets.cosines[0])) == pytest.approx([0, 18.6], abs=1)


def test_jaws_that_turn_too_far_are_refused_with_angle_and_opening(tmp_path):
    message = refused(turning(tmp_path, opening="[0.01, 0.07]"))
    assert "degrees away from the closing axis at an opening of" in message


def test_a_stroke_on_no_rising_stretch_is_refused_with_the_course_of_the_opening(tmp_path):
    message = refused(turning(tmp_path, opening="[0.01, 0.2]"))
    assert "no stretch on which it only rises" in message


def test_the_normal_of_a_pad_may_be_given(tmp_path):
    gripper = load_gripper(turning(tmp_path, normal=", normal: [0, -2, 0]"))
    np.testing.assert_allclose(gripper.pads[1].normal, [0, -1, 0])


def test_an_object_narrower_than_the_pads_close_is_no_contact(tmp_path):
    gripper = load_gripper(write_gripper(tmp_path, replace=[("opening: [0, 0.05]", "opening: [0.02, 0.05]")]))
    (check,) = check_grasps(on_canonical(top_grasps(gripper, 0.012)), a_box(0.012), gripper)
    assert check.status is CheckStatus.NO_CONTACT
    assert "closes to 20 mm" in check.reason
