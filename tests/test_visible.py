"""What pixels show of a mesh, against OpenGL and against rays."""

import numpy as np
import pytest
import trimesh

import grasptransfer as gt
from grasptransfer.camera import Camera
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.drawing.visible import visible_faces, visible_mask
from grasptransfer.frames import transform_points

CAMERA = Camera(420.0, 400.0, 130.3, 92.1, 256, 192)
POSE = look_at(0.6, 0.7, 0.4)


@pytest.mark.parametrize("category", ["mug", "drill"])
def test_mask_and_depth_are_those_that_opengl_draws(category):
    mesh = gt.load_category(category).canonical
    seen = visible_faces(mesh.vertices, mesh.faces, CAMERA, POSE)
    with Renderer() as renderer:
        depth = renderer.depth(mesh, CAMERA, POSE)
    assert seen.mask.sum() > 3000
    assert np.array_equal(visible_mask(mesh.vertices, mesh.faces, CAMERA, POSE), seen.mask)
    assert (seen.mask != (depth > 0)).sum() <= 2  # single precision there, double here
    both = seen.mask & (depth > 0)
    # A face seen from its edge changes its depth most within what rounding moves a pixel.
    np.testing.assert_allclose(seen.depth[both], depth[both], atol=1e-4)


def test_the_points_of_the_faces_are_seen_at_the_centres_of_their_pixels():
    mesh = gt.load_category("mug").canonical
    seen = visible_faces(mesh.vertices, mesh.faces, CAMERA, POSE)
    v, u = np.nonzero(seen.mask)
    corners = np.asarray(mesh.vertices)[mesh.faces[seen.face[v, u]]]
    points = transform_points(POSE, np.einsum("pc,pcd->pd", seen.share[v, u], corners))
    np.testing.assert_allclose(CAMERA.project(points), np.stack([u, v], -1), atol=1e-6)
    np.testing.assert_allclose(points[:, 2], seen.depth[v, u])


def test_both_sides_of_a_face_are_seen_and_none_behind_the_camera():
    corners, faces = np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0, 0.1, 0]]), np.array([[0, 1, 2]])
    pose = np.eye(4)
    pose[2, 3] = 0.5
    there = visible_faces(corners, faces, CAMERA, pose)
    assert there.mask.any()
    assert np.array_equal(there.mask, visible_faces(corners, faces[:, ::-1], CAMERA, pose).mask)
    pose[2, 3] = -0.5
    assert not visible_faces(corners, faces, CAMERA, pose).mask.any()
    assert not visible_mask(corners, faces, CAMERA, pose).any()


def test_a_mesh_that_covers_the_whole_picture_is_cut_off_at_its_border():
    box = trimesh.creation.box((2, 2, 0.1))
    pose = np.eye(4)
    pose[2, 3] = 0.55
    seen = visible_faces(box.vertices, box.faces, CAMERA, pose)
    assert seen.mask.all()
    np.testing.assert_allclose(seen.depth, 0.5)
