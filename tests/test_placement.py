"""Where grasps are placed once it is known what the picture leaves possible."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from grasptransfer.frames import rigid
from grasptransfer.grasping import (
    CollisionWorld,
    Physics,
    PlausibleObjects,
    check_grasps,
    load_gripper,
    on_canonical,
    place_grasps,
    rank_grasps,
)
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.placement import Placement
from grasptransfer.grasping.scene import Scene

PANDA = load_gripper("panda")
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # closes along x, the pads' y is the object's -y
BEAM = trimesh.creation.box(extents=(0.02, 0.3, 0.06))


def at(y, z=0.015):
    return on_canonical([Grasp("g", "beam", rigid(DOWN, np.array([0, y, z])), 0.02)])


def placed(grasps, mesh=BEAM, plausible=None, scene=None, settings=None):
    world = CollisionWorld(mesh, scene)
    plausible = plausible or PlausibleObjects.draw(mesh, physics=Physics(mass=0.24))
    checks = check_grasps(grasps, world, PANDA)
    after = place_grasps(grasps, checks, world, PANDA, plausible=plausible, settings=settings)
    before, now = (rank_grasps(*pair, PANDA, plausible=plausible) for pair in ((grasps, checks), after))
    return *after, before, now


def test_a_grasp_beside_the_weight_moves_towards_it():
    grasps, checks, before, now = placed(at(0.1))
    assert grasps[0].object_from_gripper[1, 3] < 0.096
    assert now[0] > before[0]
    assert checks[0].usable


def test_what_is_shifted_keeps_its_turn_and_closes_on_the_middle():
    start = at(0.1)
    grasps, checks, *_ = placed(start)
    pose = grasps[0].object_from_gripper
    np.testing.assert_array_equal(pose[:3, :3], start[0].object_from_gripper[:3, :3])
    assert pose[0, 3] == pytest.approx(0, abs=1e-4)
    assert grasps[0].width == pytest.approx(0.02, abs=1e-4)
    assert checks[0].contacts is not None
    assert grasps[0].contacts is not None
    np.testing.assert_allclose(checks[0].contacts, grasps[0].contacts, atol=2e-3)
    farthest = max(Placement().rings)
    assert np.linalg.norm(pose[:3, 3] - start[0].object_from_gripper[:3, 3]) < farthest + 1e-3


def test_a_grasp_at_its_best_place_stays():
    start = at(0.0)
    grasps, _, before, now = placed(start)
    assert np.linalg.norm(grasps[0].object_from_gripper - start[0].object_from_gripper) < 0.006
    assert now[0] >= before[0] - 0.02


def test_doubt_of_the_height_asks_for_room_before_the_palm():
    post = trimesh.creation.box(extents=(0.02, 0.02, 0.12))
    points, faces = trimesh.sample.sample_surface(post, 3000, seed=0)[:2]
    ways = np.zeros((16, 3))
    ways[:, 2] = np.linspace(-0.02, 0.02, 16)
    normals = np.tile(post.face_normals[faces], (16, 1, 1))
    seen = PlausibleObjects(np.asarray(points) + ways[:, None], normals, ways, np.full(16, 0.1))
    start = at(0.0, z=0.025)  # the palm is 2 mm above the post
    grasps, _, before, now = placed(start, post, seen)
    assert grasps[0].object_from_gripper[2, 3] > 0.028
    assert now[0] > before[0] + 0.02


def test_no_place_inside_an_obstacle_is_taken():
    wall = trimesh.creation.box(extents=(0.2, 0.02, 0.06))
    beside = Scene((("wall", wall, rigid(np.eye(3), np.array([0.0, 0.061, 0.07]))),))
    grasps, checks, *_ = placed(at(0.1), scene=beside)
    assert checks[0].usable
    blocked = check_grasps(at(0.092), CollisionWorld(BEAM, beside), PANDA)[0]
    assert not blocked.usable  # where it would go without the obstacle
    assert grasps[0].object_from_gripper[1, 3] > 0.095


def test_all_usable_grasps_are_placed_and_all_come_back_in_order():
    grasps = [*at(0.5), *at(0.1), *at(0.09)]
    after, checks, *_ = placed(grasps)
    assert [check.usable for check in checks] == [False, True, True]
    assert after[0] is grasps[0]
    assert after[1] is not grasps[1]
    assert after[2] is not grasps[2]
    nothing = place_grasps([], [], CollisionWorld(BEAM), PANDA, plausible=PlausibleObjects.draw(BEAM))
    assert nothing == ((), ())


def test_a_grasp_moves_as_little_as_what_it_is_placed_by():
    after = placed(at(0.1))[0][0]
    for by in (1e-5, 1e-4, 1e-3):
        moved = BEAM.copy()
        moved.vertices = moved.vertices * (1 + by)
        other = placed(at(0.1), moved)[0][0]
        apart = np.linalg.norm(other.object_from_gripper[:3, 3] - after.object_from_gripper[:3, 3])
        assert apart < 2e-4 * by / 1e-5 + 1e-5  # of the surface itself, up to 0.15 m from the origin


def test_a_grasp_given_an_opening_keeps_it():
    asked = [replace(at(0.1)[0], opening=0.05)]
    assert placed(asked)[1][0].opening == pytest.approx(0.05, abs=1e-4)


def test_where_the_object_is_in_doubt_across_the_pads_the_hand_opens_wider():
    ways = np.zeros((16, 3))
    sure = placed(at(0.0), plausible=seen_across(ways))[1][0].opening
    ways[:, 0] = np.linspace(-0.02, 0.02, 16)
    unsure = placed(at(0.0), plausible=seen_across(ways))[1][0].opening
    assert unsure > sure + 0.02


def seen_across(ways):
    """Draws of the beam, each shifted [m]."""
    points, faces = trimesh.sample.sample_surface(BEAM, 3000, seed=0)[:2]
    normals = np.tile(BEAM.face_normals[faces], (len(ways), 1, 1))
    return PlausibleObjects(np.asarray(points) + ways[:, None], normals, ways, np.full(len(ways), 0.1))


def test_half_of_the_draws_are_pairs_that_span_the_same_directions():
    seen = PlausibleObjects.draw(BEAM)
    half = seen.half()
    assert len(half.points) == len(seen.points) / 2
    np.testing.assert_allclose(half.centres.mean(axis=0), seen.centres.mean(axis=0), atol=1e-4)
    np.testing.assert_allclose(half.centres.std(axis=0), seen.centres.std(axis=0), atol=5e-4)
