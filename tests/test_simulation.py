"""Checks that the simulation is honest: it must not hold what nobody holds, nor drop what sits squarely."""

import dataclasses
import json
import sys

import numpy as np
import pytest
import trimesh
from simulated_box import BOX, LIFT_SHAKE, PANDA, Placed, from_above, from_the_side, held, own

from grasptransfer.errors import MeshError, SettingsError
from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping import list_grippers, load_gripper
from grasptransfer.simulation import (
    PROTOCOLS,
    Perturbation,
    TrialStatus,
    load_protocol,
    motion,
    simulate,
)
from grasptransfer.simulation.body import body_of
from grasptransfer.simulation.engines import installed_engines, list_engines, open_world
from grasptransfer.simulation.hand import hand_of
from grasptransfer.simulation.job import Conditions, Job
from grasptransfer.simulation.trial import Phases
from grasptransfer.simulation.watched_motion import WatchedMotion
from grasptransfer.solids.decomposition import decompose
from grasptransfer.solids.reduced_hull import reduced_hull

SMALL_ERRORS = Perturbation(position=0.001, degrees=1.0, friction=0.2)


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRASPTRANSFER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module", params=list_engines())
def engine(request):
    """Each of the engines; one that cannot be installed here is no engine of this machine."""
    if request.param not in installed_engines():
        assert request.param == "pybullet"
        assert sys.version_info >= (3, 12)
        pytest.skip("PyBullet has no wheels for this Python")
    return request.param


@pytest.fixture(scope="module")
def square(engine):
    """A box grasped squarely in three ways, with small errors."""
    grasps = [
        Placed("top", from_above(z=0.035), width=0.04),
        Placed("middle", from_the_side(), width=0.04),
        Placed("low", from_the_side(z=-0.03), width=0.04),
    ]
    return simulate(grasps, BOX, engine=engine, trials=4, perturb=SMALL_ERRORS)


# ---- what must and must not be held


@pytest.mark.parametrize("protocol", sorted(PROTOCOLS))
def test_an_empty_gripper_never_lifts(protocol, engine):
    nothing = [from_above(x=0.3), from_above(z=0.12), from_the_side(y=-0.2), from_above(y=0.1, z=0.03)]
    results = simulate(nothing, BOX, engine=engine, protocol=protocol, frames=10)
    assert {result.status for result in results} == {TrialStatus.NO_CONTACT}
    for result in results:
        heights = result.recording.world_from_object[:, 2, 3]
        assert np.ptp(heights) < 1e-4  # m: nor does anything else lift it


def test_a_box_held_squarely_is_always_held(square):
    assert {result.status for result in square} == {TrialStatus.HELD}
    assert max(result.slip_mm for result in square) < 5


def test_a_heavy_box_held_squarely_is_held_on_the_table_and_in_the_air(engine):
    heavy = trimesh.creation.box([0.06, 0.18, 0.18])
    assert body_of(heavy, LIFT_SHAKE).mass == pytest.approx(0.972)
    for protocol in PROTOCOLS:
        (result,) = simulate(
            [Placed("top", from_above(z=0.075), width=0.06)], heavy, engine=engine, protocol=protocol
        )
        assert result.held, result


def test_penetration_stays_below_a_millimetre(square, engine):
    hard = simulate([Placed("edge", from_above(x=0.004, z=0.05), width=0.04)], BOX, engine=engine, trials=6)
    assert max(result.max_penetration_mm for result in [*square, *hard]) < 1


def test_friction_holds_what_coulomb_says_and_no_more(engine):
    weight, force = 0.12 * 9.81, 2.0
    limit = weight / (2 * force)  # two pads
    slow = own(grip_force=force, lift_time=1.0, shake_acceleration=0.0, turn_degrees=0.0)
    hurry = 1 + 0.1 * 5.78 / 9.81  # peak acceleration of the minimum-jerk lift
    grasp = Placed("middle", from_the_side(), width=0.04)
    (slides,) = simulate([grasp], BOX, engine=engine, protocol=slow, friction=0.8 * limit)
    (sticks,) = simulate([grasp], BOX, engine=engine, protocol=slow, friction=1.25 * limit * hurry)
    assert slides.status is TrialStatus.SLIPPED_LIFT
    assert sticks.held
    assert sticks.slip_mm < 2


def test_success_falls_with_friction(engine):
    grasp = Placed("end", from_above(z=0.05), width=0.04)
    counts = [held(simulate([grasp], BOX, engine=engine, trials=6, friction=mu)) for mu in (0.8, 0.03, 0.01)]
    assert counts[0] == 6
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 0


def test_success_falls_with_the_error_of_the_opening(engine):
    def count(error):
        grasp = Placed("middle", from_the_side(), width=0.04, opening=0.06 - error)
        return held(simulate([grasp], BOX, engine=engine, trials=6))

    counts = [count(error) for error in (0.0, 0.014, 0.022)]
    assert counts[0] == 6
    assert counts[0] > counts[1] > counts[2] == 0


def test_each_failure_has_its_reason(engine):
    wide = trimesh.creation.box([0.09, 0.05, 0.12])
    cases = [
        (BOX, Placed("deep", from_above(z=-0.03), width=0.04), TrialStatus.IN_COLLISION, "pre-check"),
        (wide, Placed("wide", from_the_side(), width=0.09), TrialStatus.TOO_WIDE, "pre-check"),
        (wide, Placed("wide", from_the_side(), opening=0.08), TrialStatus.TOO_WIDE, "pre-check"),
    ]
    roof = trimesh.creation.box([0.2, 0.05, 0.01], trimesh.transformations.translation_matrix([0, 0, 0.1]))
    hook = BOX + roof
    cases.append(
        (hook, Placed("under", from_above(z=0.02), width=0.04), TrialStatus.IN_COLLISION, "pre-check")
    )
    away = Placed("below the roof", from_the_side(), width=0.04, approach_distance=0.3)
    wall = trimesh.creation.box([0.2, 0.01, 0.2], trimesh.transformations.translation_matrix([0, -0.3, 0]))
    cases.append((BOX + wall, away, TrialStatus.BLOCKED_APPROACH, "approach"))
    for mesh, grasp, status, phase in cases:
        (result,) = simulate([grasp], mesh, engine=engine)
        assert (result.status, result.phase) == (status, phase), result


# ---- the body and the engine


def test_mass_centre_and_inertia_in_the_engine_are_those_of_the_mesh(engine):
    corner = trimesh.boolean.union(
        [
            trimesh.creation.box([0.12, 0.03, 0.03]),
            trimesh.creation.box(
                [0.03, 0.03, 0.12], trimesh.transformations.translation_matrix([0.045, 0, 0.045])
            ),
        ]
    )
    corner.apply_transform(trimesh.transformations.rotation_matrix(0.4, [1, 2, 3], [0.02, 0, 0]))
    with open_world(engine, body_of(corner, LIFT_SHAKE), hand_of(PANDA), LIFT_SHAKE) as world:
        world.load(Conditions(0.8, world.body.mass, 40.0))
        mass, centre, inertia = world.object_dynamics()
        placed = world.world_from_object()
    assert mass == pytest.approx(500 * corner.volume, rel=1e-6)
    np.testing.assert_allclose(centre, corner.center_mass, atol=1e-6)
    expected = corner.moment_inertia * 500
    np.testing.assert_allclose(inertia, expected, atol=1e-6 * np.trace(expected))
    np.testing.assert_allclose(placed, np.eye(4), atol=1e-6)


def test_a_hollow_body_weighs_its_walls_and_stays_hollow():
    cup = trimesh.creation.annulus(0.036, 0.04, 0.09)
    solid = decompose(cup)
    assert solid.volume == pytest.approx(cup.volume, rel=1e-6)
    hulls = [trimesh.convex.convex_hull(part) for part in solid.parts]
    assert sum(hull.volume for hull in hulls) < 1.6 * cup.volume
    assert not any(hull.contains([[0.0, 0.0, 0.0]])[0] for hull in hulls)


def test_millimetres_and_flat_sheets_are_no_bodies():
    for bad in (trimesh.creation.box([40, 50, 120]), trimesh.creation.box([0.1, 0.1, 1e-6])):
        with pytest.raises(MeshError):
            body_of(bad, LIFT_SHAKE)


def test_a_reduced_hull_keeps_flat_faces_and_comes_within_its_tolerance():
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(3, 0.03).vertices
    slab = np.clip(ball, -0.02, 0.02) * [2, 1, 1]  # rounded, with six flat faces of many vertices
    few = reduced_hull(slab, 96, tolerance=1e-4)
    assert len(few) <= 96
    hull, whole = trimesh.convex.convex_hull(few), trimesh.convex.convex_hull(slab)
    np.testing.assert_allclose(hull.extents, whole.extents, atol=1e-9)
    points = whole.sample(500, seed=int(rng.integers(100)))
    assert trimesh.proximity.signed_distance(hull, points).min() > -1.5e-3


@pytest.mark.parametrize("name", [name for name in list_grippers() if not load_gripper(name).pads_turn])
def test_every_gripper_of_parallel_pads_closes_symmetrically_on_a_box(name, engine):
    gripper = load_gripper(name)
    body, protocol = body_of(BOX, LIFT_SHAKE), LIFT_SHAKE
    with open_world(engine, body, hand_of(gripper), protocol) as world:
        # The box stands 4 mm off the middle: the fingers must push it there.
        job = Job(
            "middle",
            0,
            from_the_side(x=0.004),
            0.04,
            gripper.approach_opening(0.04),
            0.1,
            Conditions(0.8, body.mass, min(protocol.grip_force, gripper.force_limit)),
        )
        trial = Phases(WatchedMotion(world, job))
        trial.gripper.place(job.object_from_tcp, job.opening)
        trial.close(job.object_from_tcp)
        hand = trial.gripper
        tcp_from_object = invert(hand.world_from_tcp()) @ world.world_from_object()
        assert abs(tcp_from_object[0, 3]) < 5e-4
        assert hand.opening() == pytest.approx(0.04, abs=1e-3)
        states = hand.joint_values()
        wanted = hand.hand.joint_positions(hand.opening())
        span = max(abs(value) for value in (*wanted.values(), 0.02))
        for state, (joint, _) in zip(states, hand.hand.joints, strict=True):
            assert state == pytest.approx(wanted[joint], abs=0.02 * span), joint
        tcp_from_world, poses = invert(hand.world_from_tcp()), hand.link_poses()
        low, high = (transform_points(tcp_from_world @ poses[pad.link], pad.centre) for pad in gripper.pads)
        assert abs(low[0] + high[0]) / 2 < 5e-4  # m off the middle
        np.testing.assert_allclose(low[1:], high[1:], atol=5e-4)
    (result,) = simulate([Placed("middle", from_the_side(), width=0.04)], BOX, gripper, engine=engine)
    assert result.held, result


# ---- numbers that do not depend on how they are computed


def test_half_the_time_step_gives_the_same_verdicts(engine):
    can = trimesh.creation.cylinder(0.03, 0.1, sections=48)
    verdicts = []
    end, top = Placed("end", from_above(z=0.05), width=0.04), Placed("can", from_above(z=0.03), width=0.06)
    for protocol in (own(), own(time_step=LIFT_SHAKE.time_step / 2)):
        held_ones = [*simulate([end], BOX, engine=engine, protocol=protocol, trials=6),
                     *simulate([top], can, engine=engine, protocol=protocol, trials=6)]  # fmt: skip
        dropped = simulate([end], BOX, engine=engine, protocol=protocol, trials=8, friction=0.01)
        verdicts.append([result.held for result in [*held_ones, *dropped]])
    first, second = np.array(verdicts)
    assert np.mean(first == second) >= 0.95
    assert 0.1 < first.mean() < 0.9  # both verdicts occur


# ---- protocols, paths, records


def test_a_published_protocol_cannot_be_given_other_numbers():
    assert load_protocol("lift-shake-v1") is LIFT_SHAKE
    with pytest.raises(SettingsError, match="name of its own"):
        load_protocol(dataclasses.replace(LIFT_SHAKE, friction=2.0))
    with pytest.raises(SettingsError, match="lift-shake-v1"):
        load_protocol("lift-and-hope")
    with pytest.raises(SettingsError, match="time_step"):
        load_protocol(own(time_step=0.0))
    assert json.loads(json.dumps(LIFT_SHAKE.as_data()))["friction"] == LIFT_SHAKE.friction


@pytest.mark.parametrize(("key", "value"), [("seed", -1), ("trials", 0), ("workers", 0), ("friction", -1.0)])
def test_numbers_that_no_run_can_use_are_refused(key, value):
    with pytest.raises(SettingsError, match=key):
        simulate([], trimesh.creation.box((0.05, 0.05, 0.05)), **{key: value})


def test_the_shake_pulls_with_one_g_both_ways_and_ends_at_rest():
    fine = own(time_step=1e-4)
    swing, turns = motion.swing(fine), motion.turns(fine)
    acceleration = np.diff(swing, 2) / 1e-8
    assert acceleration.max() == pytest.approx(9.81, rel=0.01)
    assert acceleration.min() == pytest.approx(-9.81, rel=0.01)
    assert abs(swing[-1] - swing[-2]) / 1e-4 < 1e-3  # m/s
    assert np.degrees(turns.max()) == pytest.approx(30, rel=1e-3)
    assert np.degrees(turns.min()) == pytest.approx(-30, rel=1e-3)
    assert turns[-1] == pytest.approx(0, abs=1e-9)
