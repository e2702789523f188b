"""The renderer against analytic spheres: geometry, coverage, transparency."""

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.camera import Camera
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.drawing.rendering import Renderer, position_image
from grasptransfer.drawing.views import look_at, sphere_views
from grasptransfer.frames import rigid, transform_points
from grasptransfer.perception.zoom import zoom_box, zoom_camera, zoom_picture

OFF_CENTRE = Camera(400.0, 380.0, 100.0, 70.0, 256, 192)
RADIUS = 0.1
POSE = rigid(np.eye(3), np.array([0.03, 0.05, 0.5]))


@pytest.fixture(scope="module")
def renderer():
    with Renderer() as made:
        yield made


def _sphere() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=6, radius=RADIUS)


def test_depth_belongs_to_pixel_centres_with_an_off_centre_principal_point(renderer):
    depth = renderer.depth(_sphere(), OFF_CENTRE, POSE)
    v, u = np.nonzero(depth)
    rays = OFF_CENTRE.unproject(np.stack([u, v], -1).astype(float), np.ones(len(u)))
    a, b = (rays**2).sum(1), rays @ POSE[:3, 3]
    root = b**2 - a * (POSE[:3, 3] @ POSE[:3, 3] - RADIUS**2)
    inner = root > 1e-4  # at the rim the depth has no slope to measure
    expected = (b - np.sqrt(np.maximum(root, 0))) / a
    # Half a pixel of offset would show as 0.4 mm; the facets of the sphere are 0.01 mm deep.
    assert np.abs(expected - depth[v, u])[inner].mean() < 5e-5


def test_closing_one_renderer_leaves_another_working(renderer):
    before = renderer.depth(_sphere(), OFF_CENTRE, POSE)
    with Renderer() as other:
        np.testing.assert_array_equal(other.depth(_sphere(), OFF_CENTRE, POSE), before)
    np.testing.assert_array_equal(renderer.depth(_sphere(), OFF_CENTRE, POSE), before)


def test_positions_project_back_to_their_pixels(renderer):
    depth = renderer.depth(_sphere(), OFF_CENTRE, POSE)
    positions = position_image(depth, OFF_CENTRE, POSE)
    v, u = np.nonzero(depth)
    pixels = OFF_CENTRE.project(transform_points(POSE, positions[v, u].astype(float)))
    np.testing.assert_allclose(pixels, np.stack([u, v], -1), atol=1e-3)  # float32 positions
    assert np.isnan(positions[depth == 0]).all()


def test_coverage_is_whole_inside_and_partial_at_edges_only(renderer):
    picture = renderer.render(_sphere(), OFF_CENTRE, POSE)
    rim = (picture.alpha > 0) & (picture.alpha < 1)
    assert picture.alpha[picture.mask & ~rim].min() == 1
    assert 0 < rim.sum() < 0.2 * picture.mask.sum()


def test_half_transparent_objects_let_half_of_the_background_through(renderer):
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    material = PBRMaterial(baseColorFactor=[200, 60, 60, 128], alphaMode="BLEND")
    box.visual = TextureVisuals(uv=np.zeros((8, 2)), material=material)
    picture = renderer.render(box, OFF_CENTRE, POSE)
    inside = picture.alpha[70:110, 110:130]
    # Light passes two faces of opacity one half each, so a quarter of it arrives, or a half where
    # the near face hides the far one.
    assert 0.4 < inside.mean() < 0.8
    black, white = np.zeros((192, 256, 3), np.uint8), np.full((192, 256, 3), 255, np.uint8)
    assert (picture.over(white)[90, 120].astype(int) > picture.over(black)[90, 120]).all()


def test_there_are_74_different_upright_views():
    views = sphere_views(0.5)
    assert views.shape == (74, 4, 4)
    directions = -np.einsum("vji,vj->vi", views[:, :3, :3], views[:, :3, 3])
    assert len(np.unique(np.round(directions, 6), axis=0)) == 74
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 0.5)
    # Object's z axis points up in the picture (OpenCV: -v), save from straight above or below.
    assert (views[1:-1, 1, 2] < 0).all()


def test_a_camera_at_azimuth_zero_sees_the_front():
    front = transform_points(look_at(1.0, 0.0, 0.3), np.array([0.1, 0, 0]))
    assert front[2] < 1.0  # nearer than the origin


def test_zooming_a_picture_equals_rendering_with_the_zoomed_camera(renderer):
    camera = Camera.from_fov(1280, 960, np.deg2rad(40))
    mesh = trimesh.creation.box([0.12, 0.05, 0.08])
    pose = look_at(0.9, 0.7, 0.5)
    crop = zoom_box(projected_box(mesh.vertices, camera, pose))
    cut = zoom_picture(renderer.render(mesh, camera, pose).rgb, crop).astype(float)
    direct = renderer.render(mesh, zoom_camera(camera, crop), pose).rgb.astype(float)
    # Both blur edges differently; a shift of one pixel would give a mean difference near 3.
    assert np.abs(cut - direct).mean() < 1.0


def test_zooming_beyond_the_border_repeats_it():
    picture = np.full((100, 100, 3), 77, np.uint8)
    assert (zoom_picture(picture, (-40.0, -30.0, 88.0, 66.0)) == 77).all()
