"""Scenes of meshes, clouds and depth pictures: what is met, and what is refused."""

import numpy as np
import pytest
import trimesh

import grasptransfer as gt
from grasptransfer.errors import GraspFileError, MeshError, PoseError, SceneError
from grasptransfer.frames import rigid
from grasptransfer.grasping import PlausibleObjects, Scene, check_grasps, load_gripper, on_canonical
from grasptransfer.grasping.collision import CheckStatus
from grasptransfer.grasping.grasp import Grasp
from grasptransfer.grasping.world import CollisionWorld

PANDA = load_gripper("panda")
BOX = trimesh.creation.box(extents=(0.03, 0.03, 0.1))
ABOVE = rigid(np.diag([1.0, -1, -1]), np.array([0, 0, 0.04]))
HERE = np.eye(4)


def check(scene, camera_from_object=None):
    grasp = Grasp("g", "box", ABOVE, 0.03, approach_distance=0.05)
    return check_grasps(on_canonical([grasp]), CollisionWorld(BOX, scene, camera_from_object), PANDA)[0]


def wall(y):
    """A wall beside the hand, as a mesh and as the points that a sensor would see of it."""
    mesh = trimesh.creation.box(extents=(0.4, 0.01, 0.4)).apply_translation([0, y + 0.005, 0.1])
    return mesh, trimesh.sample.sample_surface_even(mesh, 20_000, seed=0)[0]


@pytest.mark.parametrize(("y", "free"), [(0.02, False), (0.08, True)])
def test_a_cloud_is_met_as_the_mesh_that_it_shows(y, free):
    mesh, points = wall(y)
    for shape in (mesh, np.asarray(points), trimesh.PointCloud(points)):
        result = check(Scene((("wall", shape, HERE),)))
        assert result.usable == free
        assert free or result.obstacle == "wall"


def test_a_cloud_lies_where_its_pose_puts_it():
    _, points = wall(0.02)
    camera_from_object = rigid(np.diag([1.0, -1, -1]), np.array([0, 0, 0.6]))
    there = Scene((("wall", np.asarray(points), camera_from_object),))
    assert not check(there, camera_from_object).usable
    assert check(there).usable  # far away from an object at the camera


def test_what_a_cloud_shows_of_the_object_itself_blocks_nothing():
    points = np.asarray(trimesh.sample.sample_surface_even(BOX, 5000, seed=0)[0])
    rng = np.random.default_rng(0)
    seen = points + rng.normal(size=points.shape) * 0.002
    assert check(Scene((("depth", seen, HERE),))).usable


def test_a_depth_picture_is_a_cloud_in_the_cameras_frame():
    camera = gt.Camera.from_fov(64, 48, np.deg2rad(60))
    depth = np.full((48, 64), 0.5)
    depth[:, :32] = 0
    without = np.zeros((48, 64), bool)
    without[:24] = True
    scene = Scene.of_depth(depth, camera, without=without)
    (name, cloud, pose), points = scene.obstacles[0], np.asarray(scene.obstacles[0][1].vertices)
    assert name == "depth"
    np.testing.assert_array_equal(pose, np.eye(4))
    assert len(points) == 24 * 32
    np.testing.assert_allclose(points[:, 2], 0.5)
    assert len(cloud.vertices) == len(points)
    pixels = points[:, :2] / 0.5 * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    assert pixels.min(axis=0) == pytest.approx([32, 24])
    assert pixels.max(axis=0) == pytest.approx([63, 47])


def test_depths_that_make_no_sense_are_refused():
    camera = gt.Camera.from_fov(64, 48, np.deg2rad(60))
    for depth, words in (
        (np.zeros((48, 64)), "shows nothing"),
        (np.full((48, 64), np.nan), "shows nothing"),
        (np.ones((64, 48)), "camera's size"),
        (np.full((48, 64), 700.0), "metres"),
    ):
        with pytest.raises(SceneError, match=words):
            Scene.of_depth(depth, camera)


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (("a", trimesh.Trimesh(), HERE), "a: is empty"),
        (("a", np.zeros((0, 3)), HERE), "a: must be a mesh"),
        (("a", None, HERE), "a: must be a mesh"),
        (("a", "mug.glb", HERE), "a: must be a mesh"),
        (("a", np.full((4, 3), np.nan), HERE), "a: has points"),
        (("a", trimesh.creation.box([400, 1, 1]), HERE), "a: .*millimetres"),
        (BOX, "is no obstacle"),
        (("a", BOX), "is no obstacle"),
        ((3, BOX, HERE), "is no obstacle"),
    ],
)
def test_an_obstacle_that_is_none_is_refused_by_name(obstacle, words):
    with pytest.raises(SceneError, match=words):
        Scene((obstacle,))


def test_a_scene_of_parts_is_one_obstacle():
    parts = trimesh.Scene([wall(0.02)[0]])
    assert check(Scene((("wall", parts, HERE),))).obstacle == "wall"


@pytest.mark.parametrize(
    "plane",
    [
        ("a", "b"),
        (1, 2, 3),
        (np.zeros(3), np.zeros(3)),
        (np.zeros(2), np.ones(3)),
        ([0, 0, 10**400], [0, 0, 1]),
    ],
)
def test_a_plane_that_is_none_is_refused(plane):
    with pytest.raises(SceneError, match="support_plane"):
        Scene(support_plane=plane)


def test_a_room_with_a_hole_still_encloses_everything():
    room = trimesh.creation.icosphere(radius=1.0)
    room.update_faces(np.arange(len(room.faces)) > 2)
    result = check(Scene((("room", room, HERE),)))
    assert result.status is CheckStatus.IN_COLLISION
    assert "inside room" in result.reason


def test_an_open_bin_of_thin_sheets_is_entered_from_above():
    bin_ = trimesh.creation.box((0.6, 0.6, 0.3))
    bin_.update_faces(bin_.face_normals[:, 2] < 0.5)
    assert check(Scene((("bin", bin_, HERE),))).usable


@pytest.mark.parametrize("key", ["width", "approach_distance", "opening"])
@pytest.mark.parametrize("value", [-0.1, np.nan, 80.0])
def test_a_length_of_a_grasp_that_is_none_is_refused(key, value):
    lengths = {"width": 0.03, "approach_distance": 0.05, "opening": 0.05} | {key: value}
    with pytest.raises(GraspFileError, match=key):
        Grasp("g", "box", ABOVE, lengths["width"], lengths["approach_distance"], opening=lengths["opening"])


def test_a_flat_mesh_encloses_nothing_to_weigh():
    flat = trimesh.Trimesh([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]], [[0, 1, 2]])
    with pytest.raises(MeshError, match="flat"):
        PlausibleObjects.draw(flat)


def test_a_pose_that_is_none_is_refused_by_the_obstacles_name():
    with pytest.raises(PoseError, match=r"obstacles\.a\.camera"):
        Scene((("a", BOX, np.diag([1.0, 1, -1, 1])),))


@pytest.mark.parametrize(("height", "status"), [(0.05, CheckStatus.BLOCKED_LIFT), (0.15, CheckStatus.FREE)])
def test_a_hand_that_comes_from_the_side_is_lifted_free_of_a_shelf_above(height, status):
    side = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # comes along y, closes along x
    hand = PANDA.link_meshes(0.05)["panda_hand"].bounds  # its y is the object's -z
    under = max(-hand[0, 1], hand[1, 1])
    shelf = trimesh.creation.box(extents=(0.6, 0.6, 0.01)).apply_translation([0, 0, under + height + 0.005])
    grasp = Grasp("g", "box", rigid(side, np.zeros(3)), 0.03, approach_distance=0.05)
    world = CollisionWorld(BOX, Scene((("shelf", shelf, HERE),)))
    result = check_grasps(on_canonical([grasp]), world, PANDA)[0]
    assert result.status is status
    if status is CheckStatus.BLOCKED_LIFT:
        assert "above the grasp" in result.reason
        assert result.obstacle == "shelf"
