"""Laws of the whole chain, from picture to grasps, that hold whatever the network has learnt."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

import grasptransfer as gt
from grasptransfer.frames import rigid, rotation_angle
from grasptransfer.perception.observation import observe
from grasptransfer.workshop.training.wrong_inputs import turned

DEMO = gt.load_category("mug").folder / "demo"
BOX = (284.0, 183.0, 404.0, 340.0)
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])  # of the picture, left for right
MIRROR_MUG = np.diag([1.0, -1.0, 1.0, 1.0])  # the plane of a mug's handle is y = 0


@pytest.fixture(scope="module")
def flow():
    return gt.GraspTransfer("mug", device="cpu")


@pytest.fixture(scope="module")
def seen():
    """The bundled mug: picture, pose, camera and box."""
    image = np.array(Image.open(DEMO / "picture.png").convert("RGB"))
    camera = gt.Camera.load(DEMO / "camera.yaml")
    return observe(image, gt.load_pose(DEMO / "pose.yaml"), camera=camera, box=BOX)


@pytest.fixture(scope="module")
def result(flow, seen):
    return flow.grasp(seen, flow.estimator(seen))


def _changed(seen, **what):
    arguments = {"image": seen.image, "pose": seen.camera_from_object, "camera": seen.camera, "box": seen.box}
    return observe(**(arguments | what))


def _apart(first, second):
    """How far two reconstructions lie apart: mean over their vertices [m]."""
    return np.linalg.norm(np.asarray(first) - np.asarray(second), axis=1).mean()


def _surface(flow, observation):
    return flow.estimator(observation).field(np.asarray(flow.category.canonical.vertices))


def test_a_camera_that_turns_with_the_pose_sees_the_same_object(flow, seen, result):
    """The picture is resampled, and the pixels are others: 1 mm is a tenth of a pixel of the mask's."""
    turn = Rotation.from_rotvec([0.03, -0.05, 0.04]).as_matrix()
    camera = seen.camera
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([u, v], -1).reshape(-1, 2).astype(float), np.ones(u.size)) @ turn
    source = camera.project(rays)[:, ::-1].T
    image = np.stack(
        [map_coordinates(seen.image[..., c], source, order=1, mode="nearest") for c in range(3)], -1
    )
    pose = rigid(turn, np.zeros(3)) @ seen.camera_from_object
    u0, v0, u1, v1 = BOX
    corners = camera.unproject(np.array([(u0, v0), (u1, v0), (u0, v1), (u1, v1)]), np.ones(4)) @ turn.T
    pixels = camera.project(corners)
    box = (*pixels.min(0), *pixels.max(0))
    other = _changed(seen, image=image.reshape(seen.image.shape), pose=pose, box=box)
    there = flow.grasp(other, flow.estimator(other))
    assert _apart(there.mesh.vertices, result.mesh.vertices) < 0.002
    here = {grasp.name: grasp.object_from_gripper for grasp in result.grasps}
    for grasp in there.grasps:
        assert np.linalg.norm(grasp.object_from_gripper[:3, 3] - here[grasp.name][:3, 3]) < 0.01
        assert rotation_angle(grasp.object_from_gripper[:3, :3].T @ here[grasp.name][:3, :3]) < np.deg2rad(15)


def test_a_mirrored_picture_shows_the_mirrored_object(flow, seen, result):
    """Networks are not mirrored exactly: 3 mm is what they differ by on a mug of 10 cm."""
    camera = seen.camera
    width = camera.width
    mirrored = _changed(
        seen,
        image=np.ascontiguousarray(seen.image[:, ::-1]),
        pose=MIRROR @ seen.camera_from_object @ MIRROR_MUG,
        camera=replace(camera, cx=width - 1 - camera.cx),
        box=(width - 1 - BOX[2], BOX[1], width - 1 - BOX[0], BOX[3]),
    )
    estimate = flow.estimator(mirrored)
    points = np.asarray(flow.category.canonical.vertices)
    back = estimate.field(points * [1, -1, 1]) * [1, -1, 1]
    assert _apart(back, result.field(points)) < 0.003
    pose = MIRROR @ estimate.camera_from_object @ MIRROR_MUG
    assert np.linalg.norm(pose[:3, 3] - result.camera_from_object[:3, 3]) < 0.01


def test_a_cut_out_of_the_picture_with_its_camera_changes_nothing(flow, seen, result):
    camera = seen.camera
    cut = (100, 80, camera.width - 60, camera.height - 40)
    inside = camera.crop(
        (cut[0] - 0.5, cut[1] - 0.5, cut[2] - 0.5, cut[3] - 0.5), cut[2] - cut[0], cut[3] - cut[1]
    )
    part = _changed(
        seen,
        image=np.ascontiguousarray(seen.image[cut[1] : cut[3], cut[0] : cut[2]]),
        camera=inside,
        box=(BOX[0] - cut[0], BOX[1] - cut[1], BOX[2] - cut[0], BOX[3] - cut[1]),
    )
    assert _apart(_surface(flow, part), result.mesh.vertices) < 1e-4


def test_scaling_picture_and_intrinsics_together_changes_no_more_than_resampling_does(flow, seen, result):
    camera = seen.camera
    size = camera.width * 3 // 2, camera.height * 3 // 2
    image = np.asarray(Image.fromarray(seen.image).resize(size, Image.Resampling.BICUBIC))
    box = tuple(1.5 * (side + 0.5) - 0.5 for side in BOX)
    scaled = _changed(seen, image=image, camera=camera.resized(*size), box=box)
    assert _apart(_surface(flow, scaled), result.mesh.vertices) < 0.001


def test_the_order_of_grasps_and_obstacles_changes_nothing(flow, seen, result):
    reordered = gt.GraspTransfer("mug", device="cpu", estimator=flow.estimator)
    reordered.grasps = tuple(reversed(flow.grasps))
    at = seen.camera_from_object
    boxes = [
        (name, trimesh.creation.box((0.05, 0.05, 0.05)), at @ rigid(np.eye(3), np.array(place)))
        for name, place in (("left", [0.0, 0.1, 0.03]), ("behind", [0.12, 0.0, 0.0]))
    ]
    scenes = [gt.Scene(obstacles=tuple(order)) for order in (boxes, boxes[::-1])]
    first = flow.grasp(seen, result.estimate, scene=scenes[0])
    other = reordered.grasp(seen, result.estimate, scene=scenes[1])
    found = {grasp.name: (grasp.status, round(grasp.score, 9)) for grasp in first.grasps}
    assert {grasp.name: (grasp.status, round(grasp.score, 9)) for grasp in other.grasps} == found
    assert [grasp.name for grasp in other.usable] == [grasp.name for grasp in first.usable]


def test_a_pose_that_is_less_sure_gives_no_surer_statement(flow, seen, result):
    sigmas = [(0.002, 0.5), (0.01, 3.0), (0.03, 10.0)]
    found = [flow.estimator(_changed(seen, pose_sigma=sigma)).pose_sigma_posterior for sigma in sigmas]
    for surer, less in itertools.pairwise(found):
        assert less.along_ray >= surer.along_ray
        assert less.turn >= surer.turn


def test_a_pose_turned_farther_is_believed_less(flow, seen, result):
    far = [
        flow.estimator.assess(_changed(seen, pose=turned(seen.camera_from_object, 2, degrees)))[0]
        for degrees in (90, 180)
    ]
    assert max(estimate.category_score for estimate in far) < result.category_score
    assert max(estimate.trust for estimate in far) < result.estimate.trust
