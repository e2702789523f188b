import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasptransfer.errors import MeshError, PoseError, SceneError
from grasptransfer.frames import rigid
from grasptransfer.grasping.closing import close_pads
from grasptransfer.grasping.collision import MARGIN, CheckStatus, check_grasps
from grasptransfer.grasping.grasps import Grasp
from grasptransfer.grasping.gripper import load_gripper
from grasptransfer.grasping.parallel_jaw import ParallelJaw
from grasptransfer.grasping.scene import Scene, load_scene
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import on_canonical, warp_grasps
from grasptransfer.grasping.world import CollisionWorld, OpenedGripper

PANDA = load_gripper("panda")
DOWN = np.diag([1.0, -1.0, -1.0])  # approach along -z, closing along x
TIP = 0.0088  # m from the Panda's TCP to its finger tips


def box(x=0.03, y=0.03, z=0.1):
    return trimesh.creation.box(extents=(x, y, z))


def grasp_from_above(position=(0, 0, 0.04), width=0.03, rotation=DOWN, **kwargs):
    return Grasp("g", "box", rigid(np.array(rotation), np.array(position, dtype=float)), width, **kwargs)


def check(grasp, mesh=None, scene=None, gripper=PANDA, camera_from_object=None):
    world = CollisionWorld(box() if mesh is None else mesh, scene, camera_from_object)
    return check_grasps(on_canonical([grasp]), world, gripper)[0]


def test_a_box_between_the_pads_is_free_and_its_width_is_measured():
    result = check(grasp_from_above())
    assert result.status is CheckStatus.FREE
    assert result.usable
    assert result.width == pytest.approx(0.03, abs=1e-6)
    np.testing.assert_allclose(result.contacts[:, 0], [-0.015, 0.015], atol=1e-6)
    assert result.antipodality == pytest.approx(1, abs=1e-6)
    assert result.opening == pytest.approx(0.05)  # 10 mm of room on each side
    assert result.room is None


@pytest.mark.parametrize("gap", [0.0005, 0.0015, 0.0025, 0.02])
@pytest.mark.parametrize("what", ["slab", "plane"])
def test_two_millimetres_are_kept_from_obstacles_and_the_room_is_stated(gap, what):
    height = 0.04 - TIP - gap  # of what lies below the finger tips
    slab = box(0.1, 0.3, 0.02).apply_translation([0.07, 0, height - 0.01])
    plane = np.array([0, 0, height]), np.array([0, 0, 1.0])
    scene = Scene((("slab", slab, np.eye(4)),)) if what == "slab" else Scene(support_plane=plane)
    result = check(grasp_from_above(opening=0.05, approach_distance=0.02), scene=scene)
    if gap < MARGIN:
        assert result.status is CheckStatus.IN_COLLISION
        assert "2 mm are kept" in result.reason
    else:
        assert result.usable
        assert result.room == pytest.approx(gap, abs=2e-4)


def test_the_margin_is_kept_on_the_way_in_too():
    for gap, status in ((0.001, CheckStatus.BLOCKED_APPROACH), (0.005, CheckStatus.FREE)):
        hand = PANDA.link_meshes(0.05)["panda_hand"].bounds
        beam = box(0.2, 0.02, 0.02).apply_translation([0, hand[1, 1] + gap + 0.01, 0.24])
        result = check(grasp_from_above(opening=0.05), scene=Scene((("beam", beam, np.eye(4)),)))
        assert result.status is status


def test_a_wide_opening_that_would_close_on_another_part_is_not_taken():
    # A post beside the bar, 22 mm off: fully opened, a finger would push it against the bar.
    post = box(0.004, 0.01, 0.1).apply_translation([0.030, 0, 0])
    both = box(0.015) + post
    result = check(grasp_from_above(width=0.015), both)
    assert result.usable
    assert result.opening < 0.03
    assert result.width == pytest.approx(0.015, abs=1e-6)


@pytest.mark.parametrize(("shift", "free"), [(0.0098, True), (0.0102, False)])
def test_the_gap_beside_the_finger_decides_to_a_fifth_of_a_millimetre(shift, free):
    # Opened 20 mm wider than the box: 10 mm of room on each side.
    grasp = grasp_from_above((shift, 0, 0.04), opening=0.05)
    world = CollisionWorld(box())
    touching = world.touching(grasp.canonical_from_gripper, OpenedGripper(PANDA, 0.05))
    assert (not touching) == free


@pytest.mark.parametrize("depth", [0.001, 0.003, 0.006])
def test_the_collision_names_link_obstacle_and_depth(depth):
    palm = 0.0374  # m from the TCP back to the Panda's palm
    grasp = grasp_from_above((0, 0, 0.05 - palm - depth), approach_distance=0.0)
    result = check(grasp)
    assert result.status is CheckStatus.IN_COLLISION
    assert (result.link, result.obstacle) == ("panda_hand", "object")
    assert result.depth == pytest.approx(depth, abs=2e-4)
    assert f"{result.depth * 1e3:.1f} mm" in result.reason


def test_another_opening_is_tried_where_the_usual_one_does_not_fit():
    walls = [box(0.01, 0.05, 0.1).apply_translation([side * 0.034, 0, -0.01]) for side in (-1, 1)]
    scene = Scene(tuple((f"wall{i}", wall, np.eye(4)) for i, wall in enumerate(walls)))
    alone = check(grasp_from_above(width=0.015), box(0.015))
    narrow = check(grasp_from_above(width=0.015), box(0.015), scene)
    # The finger is 14.4 mm thick: with 10 mm of room it would reach 31.9 mm, past the wall at 29 mm.
    assert alone.opening == pytest.approx(0.035)
    assert narrow.usable
    assert narrow.opening == pytest.approx(0.025)


def test_fingers_may_not_close_through_an_obstacle():
    # Fully open the fingers stand outside the walls, and there is no room between wall and box.
    walls = [box(0.01, 0.05, 0.1).apply_translation([side * 0.02, 0, 0]) for side in (-1, 1)]
    scene = Scene(tuple((f"wall{i}", wall, np.eye(4)) for i, wall in enumerate(walls)))
    assert check(grasp_from_above(opening=0.08, width=0.015), box(0.015)).usable
    result = check(grasp_from_above(opening=0.08, width=0.015), box(0.015), scene)
    assert result.status is CheckStatus.IN_COLLISION
    assert "while closing" in result.reason
    assert result.obstacle.startswith("wall")


def test_an_object_wider_than_the_gripper_is_too_wide():
    result = check(grasp_from_above(width=0.09), box(0.09))
    assert result.status is CheckStatus.TOO_WIDE
    assert "90 mm" in result.reason
    assert "80 mm" in result.reason
    unknown = check(grasp_from_above(width=0.05), box(0.09))
    assert unknown.status in (CheckStatus.TOO_WIDE, CheckStatus.IN_COLLISION)


def test_pads_that_close_on_nothing_are_told():
    result = check(grasp_from_above((0, 0, 0.07)))
    assert result.status is CheckStatus.NO_CONTACT
    assert "-x and the +x pad" in result.reason


def test_a_shelf_above_blocks_the_approach_and_is_named():
    shelf = trimesh.creation.box(extents=(0.4, 0.4, 0.02))
    scene = Scene((("shelf", shelf, rigid(np.eye(3), np.array([0, 0, 0.24]))),))
    # The hand's back is 129 mm behind the TCP: free at the grasp (0.169), blocked 61 mm before it.
    result = check(grasp_from_above(), scene=scene)
    assert result.status is CheckStatus.BLOCKED_APPROACH
    assert result.obstacle == "shelf"
    assert result.before_grasp is not None
    assert 0.055 < result.before_grasp <= 0.1
    short = check(grasp_from_above(approach_distance=0.05), scene=scene)
    assert short.status is CheckStatus.BLOCKED_LIFT  # it fits in below the shelf, and cannot be lifted


def test_a_thin_sheet_across_the_way_in_is_not_jumped_over():
    sheet = trimesh.creation.box(extents=(0.5, 0.5, 0.0002))
    for height in np.linspace(0.075, 0.14, 6):
        scene = Scene((("sheet", sheet, rigid(np.eye(3), np.array([0, 0, height]))),))
        assert not check(grasp_from_above(), scene=scene).usable


def test_the_support_plane_stops_fingers_that_reach_below_it():
    plane = (np.array([0, 0, -0.05]), np.array([0, 0, 2.0]))
    low = grasp_from_above((0, 0, -0.05 + TIP + 0.003), rotation=DOWN)
    tall = box(z=0.03).apply_translation([0, 0, -0.035])
    assert check(low, tall, Scene(support_plane=plane)).usable
    deeper = grasp_from_above((0, 0, -0.05 + TIP - 0.002))
    result = check(deeper, tall, Scene(support_plane=plane))
    assert result.obstacle == "support plane"
    assert result.depth == pytest.approx(0.002, abs=1e-9)


def test_the_scene_is_given_in_the_camera_frame():
    pose = rigid(Rotation.random(rng=np.random.default_rng(0)).as_matrix(), np.array([0.1, 0.2, 0.7]))
    shelf = trimesh.creation.box(extents=(0.4, 0.4, 0.02))
    scene = Scene((("shelf", shelf, pose @ rigid(np.eye(3), np.array([0, 0, 0.24]))),))
    assert check(grasp_from_above(), scene=scene).usable
    result = check(grasp_from_above(), scene=scene, camera_from_object=pose)
    assert result.status is CheckStatus.BLOCKED_APPROACH


@settings(max_examples=8)
@given(st.integers(0, 10_000))
def test_the_verdict_stays_when_object_and_grasp_move_together(seed):
    rng = np.random.default_rng(seed)
    motion = rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.3, 0.3, 3))
    # Off the symmetric places, where rounding would decide.
    position = rng.uniform([-0.012, -0.03, 0.0], [0.012, 0.03, 0.06])
    grasp, moved_mesh = grasp_from_above(position), box()
    moved_mesh.apply_transform(motion)
    moved = Grasp("g", "box", motion @ grasp.canonical_from_gripper, 0.03)
    before, after = check(grasp), check(moved, moved_mesh)
    assert before.status is after.status
    assert before.link == after.link
    if before.usable:
        assert before.width is not None
        assert after.width is not None
        np.testing.assert_allclose(before.width, after.width, atol=1e-5)


def test_fingers_wholly_inside_a_closed_body_are_found():
    result = check(grasp_from_above((0, 0, 0), approach_distance=0.0), box(1, 1, 1))
    assert result.status in (CheckStatus.IN_COLLISION, CheckStatus.TOO_WIDE)


def test_a_grasp_that_the_field_tears_apart_is_not_trusted():
    class Torn:
        factors = (1.0, 1.0, 1.0)

        def __call__(self, points):
            return points * self.factors

        def jacobian(self, points):
            return np.broadcast_to(np.diag(self.factors), (len(points), 3, 3))

    torn = Torn()
    for torn.factors, word in (((6.0, 1.0, 1.0), "stretches 6.0"), ((1.0, -0.5, 1.0), "folds")):
        warped = warp_grasps([grasp_from_above(width=0.01)], torn, method="jacobian")
        (result,) = check_grasps(warped, CollisionWorld(box()), PANDA)
        assert result.status is CheckStatus.OUT_OF_SHAPE_SPACE
        assert word in result.reason
    assert all(status.advice.endswith(".") for status in CheckStatus)


def test_a_batch_is_checked_as_one_by_one():
    rng = np.random.default_rng(1)
    grasps = [
        Grasp(str(i), "b", rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.05, 0.05, 3)), 0.03)
        for i in range(6)
    ]
    world = CollisionWorld(box())
    together = check_grasps(on_canonical(grasps), world, PANDA)
    alone = [check_grasps(on_canonical([grasp]), world, PANDA)[0] for grasp in grasps]
    assert [c.status for c in together] == [c.status for c in alone]
    assert [c.reason for c in together] == [c.reason for c in alone]
    assert check_grasps([], world, PANDA) == ()


@pytest.mark.parametrize("name", ["robotiq_2f85", "wsg50", "parallel_jaw"])
def test_every_gripper_grasps_a_box(name):
    result = check(grasp_from_above(), gripper=load_gripper(name))
    assert result.usable
    assert result.width == pytest.approx(0.03, abs=1e-6)


def test_a_grasp_goes_to_another_gripper_by_its_tcp_or_is_too_wide_for_it(tmp_path):
    narrow = load_gripper(ParallelJaw("narrow", max_opening=0.04).write(tmp_path))
    grasp = grasp_from_above(width=0.05, opening=0.07)
    for gripper in (PANDA, *(load_gripper(name) for name in ("robotiq_2f85", "wsg50", "parallel_jaw"))):
        found = check(grasp, box(0.05), gripper=gripper)
        assert found.usable
        # The pads meet the same two faces, half a pad's height around the same TCP.
        np.testing.assert_allclose(found.contacts[:, 0], [-0.025, 0.025], atol=1e-6)
        assert abs(found.contacts[:, 2].mean() - 0.04) < gripper.pads[0].size[1] / 2
    refused = check(grasp, box(0.05), gripper=narrow)
    assert refused.status is CheckStatus.TOO_WIDE
    assert refused.reason == "the object is 50 mm wide here; narrow opens 40 mm"


def test_closing_meets_a_sphere_where_geometry_says():
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    poses = np.stack([rigid(DOWN, np.array([x, 0, 0])) for x in (0.0, 0.004)])
    closing = close_pads(Surface(sphere), poses, np.full(2, 0.08), PANDA)
    # The middle ray of each pad passes through the sphere's centre.
    np.testing.assert_allclose(closing.width, 0.06, atol=2e-4)
    # Local x of the contacts tells how far the sphere's middle is off the TCP.
    np.testing.assert_allclose(closing.local[1, :, 0].mean(), -0.004, atol=2e-4)
    assert closing.cosines.min() > 0.97


def test_points_inside_are_found_by_parity():
    surface = Surface(trimesh.creation.annulus(0.02, 0.04, 0.06))
    points = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0.029], [0, 0.03, 0.031], [0.05, 0, 0]])
    np.testing.assert_array_equal(surface.contains(points), [False, True, True, False, False])


def test_texture_seams_do_not_open_a_closed_surface():
    split = box()
    split.unmerge_vertices()
    assert not split.is_watertight
    assert Surface(split).contains(np.array([[0.0, 0, 0], [0, 0, 0.06]])).tolist() == [True, False]


def test_meshes_that_cannot_be_used_are_refused():
    with pytest.raises(MeshError, match="millimetres"):
        CollisionWorld(trimesh.creation.box(extents=(80, 80, 100)))
    with pytest.raises(MeshError, match="no triangles"):
        CollisionWorld(trimesh.Trimesh())


SCENE = """\
support_plane: {point: [0, 0, 0.8], normal: [0, -1, 0]}
obstacles:
  crate:
    box: [0.2, 0.3, 0.1]
    camera_from_obstacle: [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0.9], [0, 0, 0, 1]]
  can:
    mesh: can.stl
    camera_from_obstacle: [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0.9], [0, 0, 0, 1]]
"""


def scene_file(folder, text):
    trimesh.creation.cylinder(radius=0.03, height=0.1).export(folder / "can.stl")
    (folder / "scene.yaml").write_text(text)
    return folder / "scene.yaml"


def test_a_scene_is_read_from_yaml(tmp_path):
    scene = load_scene(scene_file(tmp_path, SCENE))
    assert [name for name, _, _ in scene.obstacles] == ["crate", "can"]
    np.testing.assert_allclose(scene.obstacles[0][1].extents, [0.2, 0.3, 0.1])
    np.testing.assert_allclose(scene.support_plane[1], [0, -1, 0])


@pytest.mark.parametrize(
    ("old", "new", "error", "says"),
    [
        ("normal: [0, -1, 0]", "normal: [0, 0, 0]", SceneError, "not zero"),
        ("normal:", "up:", SceneError, "normal"),
        ("box: [0.2, 0.3, 0.1]", "box: [0.2, 0, 0.1]", SceneError, "positive"),
        ("    box: [0.2, 0.3, 0.1]\n", "", SceneError, "mesh, box"),
        ("box: [0.2, 0.3, 0.1]", "box: [200, 300, 100]", SceneError, "millimetres"),
        ("point: [0, 0, 0.8]", "point: [0, 0, 800]", SceneError, "millimetres"),
        ("can.stl", "gone.stl", SceneError, "gone.stl"),
        ("can.stl", "scene.yaml", SceneError, "cannot be read"),
        ("[[1, 0, 0, 0.2]", "[[2, 0, 0, 0.2]", (SceneError, PoseError), "scaled"),
        ("[[1, 0, 0, 0.2]", "[[1, 0, 0, 200]", (SceneError, PoseError), "millimetres"),
        ("obstacles:", "obstacle:", SceneError, "known: obstacles, support_plane"),
    ],
)
def test_a_mistake_in_a_scene_is_named(tmp_path, old, new, error, says):
    assert old in SCENE
    path = scene_file(tmp_path, SCENE.replace(old, new, 1))
    with pytest.raises(error) as caught:
        load_scene(path)
    assert says in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_a_shape_far_from_its_category_is_not_trusted():
    world, grasps = CollisionWorld(box()), on_canonical([grasp_from_above()])
    assert check_grasps(grasps, world, PANDA, latent=np.ones(5))[0].usable
    (result,) = check_grasps(grasps, world, PANDA, latent=np.full(5, 4.0))
    assert result.status is CheckStatus.OUT_OF_SHAPE_SPACE
    assert "4.0 standard deviations" in result.reason
