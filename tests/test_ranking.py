"""Ranking over plausible objects: what the posterior of pose and shape does to a grasp's score."""

import numpy as np
import pytest
import trimesh

from grasptransfer.category import DENSITY, load_category
from grasptransfer.frames import rigid
from grasptransfer.grasping import PlausibleObjects, check_grasps, load_gripper, on_canonical, rank_grasps
from grasptransfer.grasping.enclosed_volume import enclosed
from grasptransfer.grasping.grasps import Grasp
from grasptransfer.grasping.plausible import UnknownErrors
from grasptransfer.grasping.ranking import grasp_features
from grasptransfer.grasping.success_model import FEATURES
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.reconstruction import reconstruct

PANDA = load_gripper("panda")
SURE = UnknownErrors(draws=16, shift=1e-5, turn=1e-4, pose=1.0)
FROM_ABOVE = np.diag([1.0, -1, -1])  # camera looking down the object's z, its x along the object's


@pytest.fixture(scope="module")
def mug():
    return load_category("mug")


def estimate_of(category, pose_covariance, camera_from_object):
    space = category.shape_space
    size = len(space.variances)
    covariance = np.zeros((6 + size, 6 + size))
    covariance[:6, :6] = pose_covariance
    return ShapeEstimate(
        space.field(np.zeros(size)), camera_from_object, latent=np.zeros(size), covariance=covariance
    )


def along_ray(deviation):
    covariance = np.zeros((6, 6))
    covariance[5, 5] = deviation**2
    return covariance


def drawn(category, estimate, *, seed=0, unknown=SURE):
    mesh = reconstruct(category, estimate.field)
    return PlausibleObjects.draw(mesh, category, estimate, seed=seed, unknown=unknown)


def moved(plausible):
    """How far each draw's surface lies beside the estimate's."""
    return plausible.points.mean(axis=1) - plausible.points.mean(axis=(0, 1))


def test_the_pose_is_drawn_along_the_ray_that_the_camera_sees_along(mug):
    pose = rigid(FROM_ABOVE, np.array([0, 0, 0.8]))
    ways = moved(drawn(mug, estimate_of(mug, along_ray(0.02), pose)))
    assert np.abs(ways[:, :2]).max() < 1e-3  # the object's x and y lie across the ray
    assert 0.005 < ways[:, 2].std() < 0.04


def test_a_turn_is_drawn_about_the_objects_origin_in_the_cameras_axes(mug):
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 0.1**2  # about the camera's x
    aside = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # camera x is the object's y
    estimate = estimate_of(mug, covariance, rigid(aside, np.array([0, 0, 0.8])))
    points = drawn(mug, estimate).points
    assert np.ptp(points[..., 1], axis=0).max() < 3e-3  # nothing moves along the axis
    radius = np.linalg.norm(points[..., [0, 2]], axis=2)
    assert np.ptp(radius, axis=0).max() < 3e-3  # nor towards the origin
    assert np.ptp(points[..., 2], axis=0).max() > 5e-3


def test_pose_and_latent_are_drawn_together(mug):
    pose = rigid(FROM_ABOVE, np.array([0, 0, 0.8]))
    estimate = estimate_of(mug, along_ray(0.02), pose)
    covariance = estimate.covariance.copy()
    covariance[6, 6] = 1.0
    covariance[5, 6] = covariance[6, 5] = 0.02 * 0.999  # the farther, the larger the first mode
    points = drawn(mug, ShapeEstimate(estimate.field, pose, estimate.latent, covariance)).points
    shape = points - points.mean(axis=1, keepdims=True)
    shape = shape - shape.mean(axis=0)
    size = np.einsum("smi,mi->s", shape, shape[0])
    assert abs(np.corrcoef(size, points.mean(axis=1)[:, 2])[0, 1]) > 0.98


def test_draws_lie_on_both_sides_of_the_estimate(mug):
    estimate = estimate_of(mug, along_ray(0.02), rigid(FROM_ABOVE, np.array([0, 0, 0.8])))
    surface = reconstruct(mug, estimate.field)
    plausible = drawn(mug, estimate)
    np.testing.assert_allclose(plausible.centres.mean(axis=0), surface.convex_hull.center_mass, atol=0.01)
    np.testing.assert_allclose(
        plausible.centres[:8] - plausible.centres.mean(axis=0),
        plausible.centres.mean(axis=0) - plausible.centres[8:],
        atol=1e-4,
    )
    np.testing.assert_allclose(np.linalg.norm(plausible.normals, axis=2), 1, atol=1e-9)


BAR = trimesh.creation.box(extents=(0.04, 0.16, 0.04))
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # closes across the bar, along x


def test_draws_move_as_little_as_the_estimate(mug):
    # Of equal variances every turn of the eigenvectors is as good: rounding chooses one.
    rounded = np.full((6, 6), 1e-18) + np.diag(1e-4 * np.linspace(1, 1 + 1e-14, 6))
    pose = rigid(FROM_ABOVE, np.array([0, 0, 0.8]))
    before, after = (drawn(mug, estimate_of(mug, each, pose)) for each in (1e-4 * np.eye(6), rounded))
    np.testing.assert_allclose(after.points, before.points, atol=1e-6)


def drawn_surface(mesh):
    """Points and normals of one draw."""
    points, faces = trimesh.sample.sample_surface(mesh, 3000, seed=0)[:2]
    return np.asarray(points)[None], mesh.face_normals[faces][None]


def moved_along(mesh, axis, ways):
    """A mesh whose place along one axis is in doubt: one draw for each way [m]."""
    points, normals = drawn_surface(mesh)
    centres = np.zeros((len(ways), 3))
    centres[:, axis] = ways
    normals = np.tile(normals, (len(ways), 1, 1))
    return PlausibleObjects(points + centres[:, None], normals, centres, np.full(len(ways), 0.1))


def seen_along(axis, farthest):
    return moved_along(BAR, axis, np.linspace(-farthest, farthest, 16))


def scores(plausible):
    grasps = on_canonical([Grasp("g", "across", rigid(DOWN, np.array([0, 0, 0.01])), 0.04)])
    return rank_grasps(grasps, check_grasps(grasps, BAR, PANDA), PANDA, plausible=plausible)[0]


def test_doubt_along_the_closing_line_costs_more_than_along_the_bar():
    assert scores(seen_along(0, 0.025)) < scores(seen_along(1, 0.025)) - 0.15
    assert scores(seen_along(1, 0.025)) > scores(seen_along(1, 0.0)) - 0.05


def test_of_two_grasps_alike_the_one_closing_across_the_ray_ranks_first(mug):
    # A square post seen from the front: across the ray, its distance does not move it between the pads.
    post = trimesh.creation.box(extents=(0.04, 0.04, 0.16))
    below = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # closes along y
    grasps = on_canonical(
        [
            Grasp("along", "top", rigid(DOWN, np.array([0, 0, 0.07])), 0.04),
            Grasp("across", "top", rigid(below, np.array([0, 0, 0.07])), 0.04),
        ]
    )
    seen = moved_along(post, 0, np.linspace(-0.025, 0.025, 16))  # the ray is the object's x
    along, across = rank_grasps(grasps, check_grasps(grasps, post, PANDA), PANDA, plausible=seen)
    assert across > along + 0.1


def test_clearance_is_the_room_beside_the_nearest_finger():
    grasps = on_canonical([Grasp("g", "across", rigid(DOWN, np.array([0.0, 0, 0.01])), 0.04)])
    checks = check_grasps(grasps, BAR, PANDA)
    room = (checks[0].opening - 0.04) / 2
    seen = moved_along(BAR, 0, np.array([room - 0.0015, 0.0, room + 0.0015]))
    clearance = grasp_features(grasps, checks, PANDA, plausible=seen)[0][:, FEATURES.index("clearance")]
    np.testing.assert_allclose(clearance, [1.5, 3, -1.5], atol=0.3)


def test_what_reaches_deep_into_the_palm_is_lost_however_well_the_pads_hold_it():
    post = trimesh.creation.box(extents=(0.04, 0.04, 0.16))
    grasps = on_canonical([Grasp("g", "top", rigid(DOWN, np.array([0, 0, 0.07])), 0.04)])
    checks = check_grasps(grasps, post, PANDA)
    air = 0.07 + 0.0374 - 0.08  # m from the post's top to the palm
    seen = [moved_along(post, 2, np.full(4, way)) for way in (0.0, air + 0.01)]
    free, deep = (rank_grasps(grasps, checks, PANDA, plausible=each)[0] for each in seen)
    assert free > 0.8
    assert deep < 0.1


def likely_mass(plausible):
    """Geometric mean over the draws, which lie on both sides of it [kg]."""
    return np.exp(np.log(plausible.mass).mean())


def test_what_two_overlapping_parts_fill_weighs_once():
    block, other = trimesh.creation.box([0.04, 0.04, 0.1]), trimesh.creation.box([0.04, 0.04, 0.1])
    other.apply_translation([0.0, 0.0, 0.05])
    plausible = PlausibleObjects.draw(block + other, unknown=SURE)
    assert likely_mass(plausible) == pytest.approx(DENSITY * 0.04 * 0.04 * 0.15)
    assert plausible.centres.mean(axis=0) == pytest.approx([0, 0, 0.025], abs=1e-4)


def test_a_surface_that_moves_outwards_adds_what_it_sweeps():
    box = trimesh.creation.box([0.04, 0.06, 0.1])
    points, faces = trimesh.sample.sample_surface_even(box, 4000, seed=0)
    moved = np.zeros((2, len(points), 3))
    moved[0, points[:, 2] > 0.0499, 2] = 0.005  # its top rises by 5 mm
    moved[1] = [0.01, 0, 0]
    outward = box.face_normals[faces] * box.area / len(points)
    volumes, centres = enclosed(moved, points, outward, (box.volume, box.center_mass))
    assert volumes == pytest.approx([1.05 * box.volume, box.volume], rel=0.02)
    assert centres == pytest.approx(np.array([[0, 0, 0.0025], [0.01, 0, 0]]), abs=5e-4)


@pytest.mark.parametrize("height", [0.03, 0.06, 0.09])
def test_what_stands_above_the_pads_topples_sooner_than_what_hangs_below_them(height):
    post = trimesh.creation.box(extents=(0.03, 0.09, 0.3))
    aside = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # from the side, closing along x
    places = (np.array([0, -0.03, z]) for z in (-height, height))
    grasps = on_canonical([Grasp("g", "post", rigid(aside, place), 0.03) for place in places])
    seen = PlausibleObjects.draw(post)
    low, high = rank_grasps(grasps, check_grasps(grasps, post, PANDA), PANDA, plausible=seen)
    assert 0 < low < high


def test_a_weight_beside_one_pad_counts_less_than_one_across_the_closing_line():
    bar, down = trimesh.creation.box(extents=(0.05, 0.05, 0.05)), rigid(DOWN, np.array([0, 0, 0.01]))
    grasps = on_canonical([Grasp("g", "bar", down, 0.05)])
    points, normals = drawn_surface(bar)
    moments = []
    for centre in ([0, 0, 0.01], [0.03, 0, 0.01], [0, 0.03, 0.01]):
        seen = PlausibleObjects(points, normals, np.array([centre]), np.array([0.5]))
        features = grasp_features(grasps, check_grasps(grasps, bar, PANDA), PANDA, plausible=seen)
        moments.append(float(features[0][0, FEATURES.index("moment")]))
    middle, aside, across = moments
    assert middle == pytest.approx(0, abs=1e-6)
    assert across == pytest.approx(0.5 * 3)  # kg cm
    assert 0.2 * across < aside < 0.8 * across


def test_a_cavity_weighs_nothing():
    hollow = trimesh.creation.box([0.05, 0.05, 0.1])
    cavity, knob = trimesh.creation.box([0.03, 0.03, 0.08]), trimesh.creation.box([0.02, 0.02, 0.02])
    cavity.invert()
    knob.apply_translation([0.0, 0.0, 0.055])
    plausible = PlausibleObjects.draw(hollow + cavity + knob, unknown=SURE)
    filled = 0.05 * 0.05 * 0.1 - 0.03 * 0.03 * 0.08 + 0.02 * 0.02 * 0.015
    assert likely_mass(plausible) == pytest.approx(DENSITY * filled)


def test_a_reconstruction_weighs_what_its_canonical_model_does():
    camera = load_category("camera")
    mesh = camera.canonical
    alone = PlausibleObjects.draw(mesh, unknown=SURE)
    among = PlausibleObjects.draw(mesh, camera, unknown=SURE)
    assert likely_mass(among) == pytest.approx(likely_mass(alone), rel=1e-4)
    assert among.centres.mean(axis=0) == pytest.approx(alone.centres.mean(axis=0), abs=1e-4)
    assert likely_mass(among) < 0.9 * camera.density * abs(mesh.volume)
