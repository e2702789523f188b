"""Every hand that comes along, and boxes of three widths."""

import pytest
from gripper_files import FINGERS, joint, link, mimic, write_gripper
from gripper_files import box as shape

from grasptransfer.grasping.gripper import list_grippers, load_gripper
from grasptransfer.simulation import TrialStatus
from grasptransfer.simulation.boxes import box_widths, hold_boxes
from grasptransfer.simulation.engines import installed_engines

HANDS = ("gen3_lite_2f", "open_manipulator_x", "panda", "robotiq_2f140", "robotiq_2f85", "robotiq_hande",
         "so101", "widowx_250", "wsg50", "xarm_gripper")  # fmt: skip
# A Hand-E opens 50 mm, and the fingers that a WidowX comes with close to 30 mm.
REFUSED = {("robotiq_hande", 0.05): TrialStatus.TOO_WIDE, ("widowx_250", 0.02): TrialStatus.NO_CONTACT}


def test_ten_hands_that_people_own_come_along():
    assert set(HANDS) < set(list_grippers())


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("engine", installed_engines())
def test_a_hand_holds_boxes_of_every_width_between_its_pads(name, engine):
    gripper = load_gripper(name)
    widths = box_widths(gripper)
    for width, trial in zip(widths, hold_boxes(gripper, engine=engine), strict=True):
        wanted = REFUSED.get((name, width), TrialStatus.HELD)
        assert trial.status is wanted, (width, trial.detail)
        if wanted is TrialStatus.HELD:
            assert trial.width_mm == pytest.approx(1e3 * width, abs=1), width


L_FINGERS = {
    name: link(
        name,
        '<collision><geometry><mesh filename="finger.obj"/></geometry>'
        f'<origin xyz="0 0 0.04" rpy="0 0 {0 if side > 0 else 3.14159265}"/></collision>',
    )
    for name, side in (("left", 1), ("right", -1))
}


def test_fingers_that_are_not_convex_hold_with_their_pads(tmp_path):
    import trimesh

    # An L: a thin blade, and a foot that reaches inwards 1 cm behind it.
    blade = trimesh.creation.box(extents=(0.01, 0.004, 0.08))
    blade.apply_translation([0, 0.002, 0])
    foot = trimesh.creation.box(extents=(0.01, 0.02, 0.012))
    foot.apply_translation([0, 0.01, -0.034])
    trimesh.boolean.union([blade, foot], engine="manifold").export(tmp_path / "finger.obj")
    gripper = load_gripper(write_gripper(tmp_path, fingers=L_FINGERS))
    assert len(gripper.links[1].shapes) > 1
    (trial,) = hold_boxes(gripper, [0.03])
    assert trial.held, trial.detail
    assert trial.width_mm == pytest.approx(30, abs=1)


def test_names_with_a_slash_and_a_joint_that_stands_are_executed(tmp_path):
    right = joint("arm/right", "palm", "left/finger", axis="0 -1 0", more=mimic("left_slide"))
    propeller = link("arm/propeller", shape((0.02, 0.02, 0.002))) + joint(
        "spin", "palm", "arm/propeller", kind="continuous", axis="0 0 1", at="0 0 0.055", limits=None
    )
    path = write_gripper(
        tmp_path,
        fingers={"left": FINGERS["left"], "right": FINGERS["right"].replace('"right"', '"left/finger"')},
        right=right,
        more=propeller,
        replace=[
            ("link: right", "link: left/finger"),
            ("opening:", "joints: {left_slide: {}, spin: {ratio: 0}}\nopening:"),
        ],
    )
    (trial,) = hold_boxes(load_gripper(path), [0.03])
    assert trial.held, trial.detail


def test_one_jaw_that_stands_holds_what_the_other_pushes_against_it(tmp_path):
    path = write_gripper(
        tmp_path,
        right=joint("mount", "palm", "right", kind="fixed", at="0 0 0"),
        fingers={**FINGERS, "right": link("right", shape((0.01, 0.006, 0.08), (0, -0.023, 0.09)))},
        left=joint("left_slide", "palm", "left", limits=(0, 0.05)),
        replace=[
            ("right, centre: [0, 0, 0.07]", "right, centre: [0, -0.02, 0.12]"),
            ("[0, 0.05]", "[0.02, 0.07]"),
        ],
    )
    (trial,) = hold_boxes(load_gripper(path), [0.03])
    assert trial.held, trial.detail
    # Pushed at its top, the box leans against the jaw that stands.
    assert trial.width_mm == pytest.approx(30, abs=2)


def test_a_trial_names_the_link_that_only_keeps_a_margin(tmp_path):
    margin = link("margin", shape((0.09, 0.12, 0.05), (0, 0, 0.1))) + joint(
        "margin_mount", "palm", "margin", kind="fixed", at="0 0 0"
    )
    (trial,) = hold_boxes(load_gripper(write_gripper(tmp_path, more=margin)), [0.03])
    assert trial.status is TrialStatus.IN_COLLISION
    assert "add ignore_links: [margin]" in trial.detail
    ignored = write_gripper(tmp_path, more=margin, replace=[("opening:", "ignore_links: [margin]\nopening:")])
    (trial,) = hold_boxes(load_gripper(ignored), [0.03])
    assert trial.held, trial.detail
