import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasptransfer.frames import rigid, rotation_angle
from grasptransfer.grasping.collision import CheckStatus, check_grasps
from grasptransfer.grasping.grasps import Grasp
from grasptransfer.grasping.gripper import load_gripper
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.ranking import rank_grasps
from grasptransfer.grasping.refine import refine_grasps
from grasptransfer.grasping.scene import Scene
from grasptransfer.grasping.warping import on_canonical
from grasptransfer.grasping.world import CollisionWorld

PANDA = load_gripper("panda")
DOWN = np.diag([1.0, -1.0, -1.0])
BAR = trimesh.creation.box(extents=(0.02, 0.12, 0.05))
CAN = trimesh.creation.cylinder(radius=0.03, height=0.12, sections=64)


def on(position=(0, 0, 0.015), turn=(0, 0, 0), width=0.02):
    rotation = DOWN @ Rotation.from_rotvec(turn).as_matrix()
    return on_canonical([Grasp("g", "bar", rigid(rotation, np.array(position, dtype=float)), width)])


def refined(grasps, mesh=BAR, scene=None):
    world = CollisionWorld(mesh, scene)
    better = refine_grasps(grasps, world, PANDA)
    return better, check_grasps(better, world, PANDA)


@pytest.mark.parametrize("turn", [(0, 0, 0.25), (0, 0.25, 0), (0, -0.2, -0.2), (0.2, 0, 0)])
@pytest.mark.parametrize("shift", [(0, 0, 0), (0.006, 0, 0), (-0.004, 0.003, 0.004)])
def test_pads_end_flat_and_centred_on_a_bar(turn, shift):
    (grasp,), (check,) = refined(on(np.array([0, 0, 0.015]) + shift, turn))
    assert check.usable
    # A degree or two of tilt costs less than leaving the annotation to remove it.
    assert check.antipodality is not None
    assert np.degrees(np.arccos(check.antipodality)) < 4
    assert grasp.width == pytest.approx(0.02, abs=0.001)
    assert grasp.contacts[:, 0] == pytest.approx([-0.01, 0.01], abs=1e-6)
    assert abs(grasp.object_from_gripper[0, 3]) < 0.001


def test_a_good_grasp_hardly_moves():
    (grasp,), _ = refined(on((0, 0, 0.012)))
    assert np.linalg.norm(grasp.object_from_gripper[:3, 3] - [0, 0, 0.012]) < 0.004
    assert rotation_angle(DOWN.T @ grasp.object_from_gripper[:3, :3]) < 0.06


def test_a_grasp_that_closes_just_above_finds_the_object():
    start = on((0, 0, 0.036))
    assert not check_grasps(start, CollisionWorld(BAR), PANDA)[0].usable
    (grasp,), (check,) = refined(start)
    assert check.usable
    assert grasp.object_from_gripper[2, 3] < 0.033


def test_a_palm_that_hits_the_object_backs_out():
    start = on((0, 0, -0.016))
    assert not check_grasps(start, CollisionWorld(BAR), PANDA)[0].usable
    _, (check,) = refined(start)
    assert check.usable


def test_a_wrong_width_is_corrected_on_the_surface():
    for width in (0.005, 0.045):
        (grasp,), _ = refined(on((0, 0, 0.04), width=width), CAN)
        # A pad meets the can's two outermost facets: up to the facets' sagitta below 60 mm.
        assert grasp.width == pytest.approx(0.06, abs=0.0012)


def test_refinement_stays_near_the_intention():
    rng = np.random.default_rng(0)
    for _ in range(10):
        start = on(rng.normal(size=3) * 0.004 + [0, 0, 0.015], rng.normal(size=3) * 0.15)
        (grasp,), _ = refined(start)
        before, after = start[0].object_from_gripper, grasp.object_from_gripper
        assert np.linalg.norm(after[:3, 3] - before[:3, 3]) < 0.03
        assert rotation_angle(before[:3, :3].T @ after[:3, :3]) < 0.7


def test_no_object_in_reach_leaves_the_grasp_as_it_was():
    start = on((0, 0, 0.5))
    assert refined(start)[0][0] is start[0]
    wide, block = on(width=0.09), trimesh.creation.box(extents=(0.09, 0.2, 0.05))
    assert refine_grasps(wide, CollisionWorld(block), PANDA)[0] is wide[0]


def test_a_grasp_too_wide_slides_to_where_the_gripper_fits():
    # A cone from 98 mm at y = -60 mm to 60 mm at its other end; 15 mm along it is 74 mm wide.
    cone = trimesh.creation.revolve(np.array([[0, -0.06], [0.049, -0.06], [0.03, 0.06], [0, 0.06]]))
    cone.apply_transform(rigid(Rotation.from_rotvec([-np.pi / 2, 0, 0]).as_matrix(), np.zeros(3)))
    start = on((0, 0, 0.012), width=0.079)
    assert check_grasps(start, CollisionWorld(cone), PANDA)[0].status is CheckStatus.TOO_WIDE
    (grasp,), (check,) = refined(start, cone)
    assert check.usable
    assert grasp.width < 0.075
    along = grasp.object_from_gripper[1, 3]
    assert 0.005 < along < 0.045
    assert abs(grasp.object_from_gripper[0, 3]) < 0.002


def test_a_slide_does_not_end_on_a_slope_that_pads_slip_off():
    steep = trimesh.creation.revolve(np.array([[0, -0.06], [0.06, 0.0], [0, 0.06]]))
    steep.apply_transform(rigid(Rotation.from_rotvec([-np.pi / 2, 0, 0]).as_matrix(), np.zeros(3)))
    start = on((0, 0, 0.012), width=0.12)
    assert refine_grasps(start, CollisionWorld(steep), PANDA)[0] is start[0]


def test_refinement_leaves_room_before_the_palm():
    # As deep as the palm allows: 1 mm of air. A little less deep holds as well.
    tall = trimesh.creation.box(extents=(0.02, 0.12, 0.09))
    palm = PANDA.link_meshes(0.04)["panda_hand"].bounds[1, 2]
    start = on((0, 0, 0.045 + palm + 0.001))
    (grasp,), (check,) = refined(start, tall)
    assert check.usable
    assert grasp.object_from_gripper[2, 3] + abs(palm) - 0.045 > 0.0025


def test_rotations_stay_in_so3_and_a_batch_refines_as_one_by_one():
    rng = np.random.default_rng(1)
    starts = [on(rng.normal(size=3) * 0.004, rng.normal(size=3) * 0.2)[0] for _ in range(5)]
    world = CollisionWorld(BAR)
    together = refine_grasps(starts, world, PANDA)
    for start, grasp in zip(starts, together, strict=True):
        rotation = grasp.object_from_gripper[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        alone = refine_grasps([start], world, PANDA)[0]
        np.testing.assert_allclose(alone.object_from_gripper, grasp.object_from_gripper, atol=1e-12)


def placed(name, size, centre):
    return Scene(((name, trimesh.creation.box(extents=size), rigid(np.eye(3), np.array(centre))),))


def test_refinement_moves_a_finger_off_an_obstacle():
    # A post beside the bar, where the outer finger goes: 4 mm along the bar it ends.
    scene = placed("post", (0.02, 0.044, 0.06), (0.035, -0.028, 0.0))
    before = check_grasps(on(), CollisionWorld(BAR, scene), PANDA)[0]
    assert before.status is CheckStatus.IN_COLLISION
    assert before.obstacle == "post"
    assert refined(on(), scene=scene)[1][0].usable


def test_refinement_frees_the_whole_way_in():
    # At the grasp the hand is below the beam; on its way it grazes the beam's edge by 3 mm.
    scene = placed("beam", (0.4, 0.1, 0.02), (0.0, -0.078, 0.19))
    before = check_grasps(on(), CollisionWorld(BAR, scene), PANDA)[0]
    assert before.status is CheckStatus.BLOCKED_APPROACH
    assert before.obstacle == "beam"
    assert refined(on(), scene=scene)[1][0].usable


def score(grasps, mesh=BAR, seed=0):
    world = CollisionWorld(mesh)
    plausible = PlausibleObjects.draw(mesh, seed=seed)
    return rank_grasps(grasps, check_grasps(grasps, world, PANDA), PANDA, plausible=plausible)[0]


def test_scores_are_chances_and_repeat_for_a_seed():
    grasps = on()
    assert 0.5 < score(grasps) <= 1
    assert score(grasps) == score(grasps)
    assert score(grasps, seed=1) == pytest.approx(score(grasps), abs=0.1)


def test_a_grasp_that_fails_its_check_scores_nothing():
    assert score(on((0, 0, 0.5))) == 0


def odds(grasps):
    chance = score(grasps)
    return chance / (1 - chance)


def test_better_grasps_score_higher():
    good = odds(on((0, 0, 0.012)))
    assert good > 1.5 * odds(on((0, 0, 0.012), (0, 0, 0.5)))  # pads at an angle
    assert good > 1.5 * odds(on((0, 0, 0.033)))  # only the tips touch
    assert good > odds(on((0, 0.054, 0.012)))  # at the bar's end, away from its weight


def test_what_hangs_below_the_pads_scores_higher_than_what_lies_beside_them():
    heavy = trimesh.creation.box(extents=(0.02, 0.6, 0.08))
    assert score(on((0, 0, 0.03)), heavy) > score(on((0, 0.27, 0.03)), heavy) + 0.5
    beam = trimesh.creation.box(extents=(0.02, 0.3, 0.08))
    middle, end = score(on((0, 0, 0.03)), beam), score(on((0, 0.12, 0.03)), beam)
    # The same lever straight below turns the object only as far as the hand tilts.
    post = trimesh.creation.box(extents=(0.02, 0.08, 0.3))
    hanging = score(on((0, 0, 0.12)), post)
    assert end + 0.1 < hanging < middle
    # Across an upright closing line it turns nothing: it pulls on the pads themselves.
    upright = rigid(np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]), np.array([0.12, 0, 0]))
    lying = trimesh.creation.box(extents=(0.3, 0.08, 0.02))
    assert score(on_canonical([Grasp("g", "beam", upright, 0.02)]), lying) > 0.9


def test_ranking_wants_a_check_for_each_grasp():
    assert rank_grasps([], [], PANDA, plausible=PlausibleObjects.draw(BAR)) == ()
