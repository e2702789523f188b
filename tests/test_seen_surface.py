"""Points of a model that are seen: on their lines of sight, on the surface, and moved as the latent says."""

import numpy as np
import pytest
from scipy.spatial import KDTree

import grasptransfer as gt
from grasptransfer.camera import Camera
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import transform_points
from grasptransfer.perception.seen_surface import RAYS, ShapedModel, see_surface

CAMERA = Camera.from_fov(320, 240, np.deg2rad(60))
POSE = look_at(0.4, 0.7, 0.6)


@pytest.fixture(scope="module")
def model():
    return ShapedModel(gt.load_category("mug"))


@pytest.fixture(scope="module")
def latent(model):
    return np.random.default_rng(0).normal(0, 0.7, model.category.shape_space.n_modes)


@pytest.fixture(scope="module")
def seen(model, latent):
    return see_surface(model, latent, CAMERA, POSE)


def test_points_are_seen_at_their_pixels(seen):
    pixels = CAMERA.project(transform_points(POSE, seen.points_object))
    # Rays are cast in single precision.
    np.testing.assert_allclose(pixels, seen.pixels, atol=1e-2)
    assert RAYS / 4 < len(seen.pixels) < RAYS


def test_they_are_the_first_surface_that_a_renderer_draws(model, latent, seen):
    with Renderer() as renderer:
        drawn = renderer.depth(model.mesh(latent), CAMERA, POSE)
    away = np.abs(seen.sampled(drawn.astype(float)) - seen.depth(POSE))
    # A pixel on an edge may show either side of it.
    assert np.mean(away < 1e-4) > 0.97


def test_normals_are_unit_and_face_the_camera(seen):
    np.testing.assert_allclose(np.linalg.norm(seen.normals_object, axis=1), 1, atol=1e-9)
    towards_camera = -POSE[:3, :3].T @ POSE[:3, 3] - seen.points_object
    assert ((seen.normals_object * towards_camera).sum(1) >= 0).all()


def test_the_latent_moves_them_along_with_the_surface(model, latent, seen):
    step = np.random.default_rng(1).normal(0, 0.3, len(latent))
    moved = seen.points_object + seen.by_latent @ step
    assert np.linalg.norm(moved - seen.points_object, axis=1).max() > 2e-3
    # What is linear at the corners is linear on the face: they stay on the mesh.
    samples = model.mesh(latent + step).sample(40_000, seed=0)
    spacing = np.sqrt(model.mesh(latent).area / 40_000)
    assert KDTree(np.asarray(samples)).query(moved)[0].max() < 4 * spacing


def test_chosen_points_keep_what_belongs_to_them(seen):
    chosen = seen.pixels[:, 0] > np.median(seen.pixels[:, 0])
    part = seen.where(chosen)
    np.testing.assert_array_equal(part.pixels, seen.pixels[chosen])
    np.testing.assert_array_equal(part.by_latent, seen.by_latent[chosen])
    assert len(part.points_object) == len(part.normals_object) == chosen.sum()


def test_out_of_the_picture_nothing_is_seen(model, latent):
    aside = POSE.copy()
    aside[0, 3] += 2.0
    assert len(see_surface(model, latent, CAMERA, aside).pixels) == 0
