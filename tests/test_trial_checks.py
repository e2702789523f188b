"""HELD asks that hand and object rose and joints kept in step; all that decides a trial is in its key."""

import dataclasses
import re

import numpy as np
import pytest
import trimesh
from simulated_box import BOX, PANDA, Placed, from_above, from_the_side, own

from grasptransfer.errors import GraspFileError, MeshError, SettingsError
from grasptransfer.grasping import load_gripper
from grasptransfer.grasping.gripper import GRIPPER_FOLDER
from grasptransfer.simulation import (
    PROTOCOLS,
    Perturbation,
    TrialStatus,
    installed_engines,
    robustness,
    simulate,
)
from grasptransfer.simulation.body import body_of
from grasptransfer.simulation.hand import hand_of
from grasptransfer.simulation.setup import Setup

MIDDLE = Placed("middle", from_the_side(), width=0.04)
V2 = PROTOCOLS["lift-shake-v2"]


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRASPTRANSFER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(params=installed_engines())
def engine(request):
    return request.param


def changed_gripper(folder, **replaced):
    """The plain parallel jaw with texts of its URDF or YAML replaced."""
    folder.mkdir(exist_ok=True)
    for ending in ("urdf", "yaml"):
        text = (GRIPPER_FOLDER / f"parallel_jaw.{ending}").read_text()
        for old, new in replaced.get(ending, ()):
            assert old in text
            text = text.replace(old, new)
        (folder / f"parallel_jaw.{ending}").write_text(text)
    return load_gripper(folder / "parallel_jaw.yaml")


# ---- what HELD asks for


def test_a_base_link_without_mass_is_lifted_like_any_other(tmp_path, engine):
    weightless = changed_gripper(tmp_path, urdf=[('<mass value="0.735"/>', '<mass value="0"/>')])
    (trial,) = simulate([MIDDLE], BOX, weightless, engine=engine, frames=20)
    assert trial.held, trial
    heights = trial.recording.world_from_object[:, 2, 3]
    assert heights[-1] - heights[0] == pytest.approx(0.1, abs=0.02)


def test_a_hand_that_cannot_be_lifted_holds_nothing(engine):
    (trial,) = simulate([MIDDLE], BOX, engine=engine, protocol=own(hold_force=2.0))  # N; it weighs 12
    assert trial.status is TrialStatus.UNSTABLE
    assert re.search(r"the hand rose by -?\d+ of 100 mm", trial.detail)


def test_joints_that_do_not_follow_each_other_end_the_trial():
    if "pybullet" not in installed_engines():
        pytest.skip("MuJoCo's couplings do not give way")
    off = Placed("off", from_the_side(x=0.01), width=0.04, opening=0.08)
    (trial,) = simulate([off], BOX, "robotiq_2f85", own(gear_force=0.3), engine="pybullet")
    assert trial.status is TrialStatus.OUT_OF_STEP
    assert "mm of the opening" in trial.detail


def test_a_gripper_that_opens_wider_than_the_protocol_closes_gets_the_time_it_needs(tmp_path, engine):
    wide = changed_gripper(
        tmp_path,
        urdf=[('upper="0.05"', 'upper="0.16"'), ("0.14 0.05 0.07", "0.36 0.05 0.07")],
        yaml=[("opening: [0, 0.1]", "opening: [0, 0.32]")],
    )
    for width in (0.04, 0.15, 0.29):
        box = trimesh.creation.box([width, 0.05, 0.12 * 0.04 / width])
        grasp = Placed("open", from_the_side(), width=width, opening=0.32)
        (trial,) = simulate([grasp], box, wide, engine=engine)
        assert trial.held, trial
        assert trial.width_mm == pytest.approx(1e3 * width, abs=1)


def test_the_width_is_where_the_pads_are(engine):
    for name in ("panda", "robotiq_2f85", "wsg50"):
        (trial,) = simulate([MIDDLE], BOX, name, engine=engine)
        assert trial.held
        assert trial.width_mm == pytest.approx(40, abs=1), name


# ---- mass and force


def test_force_and_mass_are_inputs_and_a_weak_hand_lets_a_heavy_box_fall(engine):
    def held(**numbers):
        (trial,) = simulate([MIDDLE], BOX, engine=engine, protocol=V2, **numbers)
        return trial.held

    assert held()
    assert held(mass=1.0, force=40)
    assert not held(mass=1.0, force=4)  # 2 pads x 4 N x 0.8 = 6.4 N, and it weighs 9.8 N
    assert held(mass=0.2, force=4)


def test_a_grippers_own_limit_bounds_the_force(tmp_path):
    weak = changed_gripper(tmp_path, yaml=[("force_limit: 60", "force_limit: 1")])
    (trial,) = simulate([MIDDLE], BOX, weak, mass=0.5, force=40)
    assert not trial.held
    assert trial.force == 1


def test_drawn_masses_lie_within_their_factor_and_leave_the_other_errors_alone():
    spread = Perturbation(mass=2.0)
    exact, drawn = (
        simulate([MIDDLE], BOX, trials=8, perturb=perturb, seed=3) for perturb in (Perturbation(), spread)
    )
    masses = np.array([trial.mass for trial in drawn])
    assert np.all((masses >= 0.06) & (masses <= 0.24))
    assert np.ptp(masses) > 0.03
    assert [trial.friction for trial in drawn] == [trial.friction for trial in exact]
    assert [trial.mass for trial in exact] == pytest.approx([0.12] * 8)


# ---- all that decides a trial is in its key


def changed(value):
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + " and more"
    if isinstance(value, frozenset):
        return value | {"another"}
    if isinstance(value, tuple) and not value:
        return (("link0_0.obj", ""),)
    if isinstance(value, tuple):
        return (*value[:-1], changed(value[-1]))
    if isinstance(value, Perturbation):
        return dataclasses.replace(value, position=value.position + 0.001)
    return value + 1


def test_every_number_of_hand_object_and_protocol_is_in_the_key():
    setup = Setup(body_of(BOX, V2), hand_of(PANDA), V2, "mujoco")
    keys = {setup.key}
    parts = [setup.body, setup.hand, setup.protocol, setup.protocol.perturbation]
    for part in parts:
        for field in dataclasses.fields(part):
            other = dataclasses.replace(part, **{field.name: changed(getattr(part, field.name))})
            if part is parts[3]:
                other = dataclasses.replace(V2, perturbation=other)
            name = {"Body": "body", "Hand": "hand", "Protocol": "protocol"}[type(other).__name__]
            keys.add(dataclasses.replace(setup, **{name: other}).key)
    keys.add(dataclasses.replace(setup, engine="pybullet").key)
    assert len(keys) == 2 + sum(len(dataclasses.fields(part)) for part in parts)


def test_the_same_urdf_with_another_force_limit_is_another_hand(tmp_path):
    strong, weak = (
        changed_gripper(tmp_path / str(force), yaml=[("force_limit: 60", f"force_limit: {force}")])
        for force in (70, 1)
    )
    ledger = tmp_path / "results.jsonl"
    verdicts = [
        simulate([MIDDLE], BOX, gripper, mass=0.5, results_path=ledger)[0].held
        for gripper in (strong, weak, strong)
    ]
    assert verdicts == [True, False, True]
    assert len(ledger.read_text().splitlines()) == 2


# ---- the second version of the protocol


def test_the_second_version_swings_on_from_where_the_hand_is():
    for version in ("lift-shake-v1", "lift-shake-v2"):
        (trial,) = simulate([MIDDLE], BOX, protocol=version, frames=240)
        shaken = [i for i, phase in enumerate(trial.recording.phases) if phase == "shake"]
        places = trial.recording.world_from_link["panda_hand"][shaken, :3, 3]
        fastest = 240 * np.linalg.norm(np.diff(places, axis=0), axis=1).max()
        swing = 9.81 * V2.shake_period / np.pi  # m/s
        assert (fastest > 1.2 * swing) == (version == "lift-shake-v1"), fastest


# ---- what cannot be executed is refused by name


def wrong(settings, key, value):
    """Past the tests' own check of types."""
    object.__setattr__(settings, key, value)
    return settings


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("density", -500.0),
        ("close_time", 0.0),
        ("lift_time", 0.0),
        ("turn_time", 0.0),
        ("shake_period", 0.0),
        ("solver_iterations", 50.0),
        ("solver_iterations", True),
        ("grip_force", float("nan")),
        ("lift_height", float("inf")),
        ("hold_force", "300"),
        ("mass_limits", (1.0, 0.05)),
        ("mass_limits", (-1.0, 1.0)),
        ("mass_limits", (1.0,)),
        ("mass_limits", None),
        ("name", None),
        ("support", "water"),
    ],
)
def test_numbers_of_an_own_protocol_that_no_physics_takes_are_refused(key, value):
    with pytest.raises(SettingsError, match=f"protocol.{key}"):
        simulate([MIDDLE], BOX, protocol=wrong(own(), key, value))


@pytest.mark.parametrize(("key", "value"), [("position", -0.1), ("degrees", float("nan")), ("mass", 0.5)])
def test_errors_that_no_trial_can_have_are_refused(key, value):
    with pytest.raises(SettingsError, match=f"perturbation.{key}"):
        simulate([MIDDLE], BOX, perturb=wrong(Perturbation(), key, value))


@pytest.mark.parametrize(
    ("key", "value"), [("mass", -1.0), ("mass", float("nan")), ("force", 0.0), ("trials", 0)]
)
def test_conditions_that_no_trial_can_have_are_refused(key, value):
    with pytest.raises(SettingsError, match=key):
        simulate([MIDDLE], BOX, **{key: value})


def test_a_negative_approach_and_flat_or_open_meshes_are_refused():
    with pytest.raises(GraspFileError, match=r"back\.approach_distance"):
        simulate([Placed("back", from_above(), width=0.04, approach_distance=-0.1)], BOX)
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    for bad in (sheet, trimesh.Trimesh(), trimesh.PointCloud(np.random.default_rng(0).random((9, 3)))):
        with pytest.raises(MeshError):
            simulate([MIDDLE], bad)  # pyright: ignore[reportArgumentType]


def test_a_trial_that_is_held_only_just_says_so():
    firm = simulate([MIDDLE], BOX)[0]
    assert firm.held
    assert 0 < firm.limit_used < 0.5
    assert not firm.near_limit
    just = dataclasses.replace(firm, limit_used=0.9)
    slipped = dataclasses.replace(just, status=TrialStatus.SLIPPED_LIFT)
    assert just.near_limit
    assert not slipped.near_limit
    assert robustness([firm, just, slipped])[0].near_limit == 1
