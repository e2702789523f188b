"""Several pictures of one object in one fit: laws on motion whose truth is known, and wrong lists refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptransfer.camera import Camera
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import CameraError, GraspTransferError, ImageError, PoseError, SettingsError
from grasptransfer.frames import invert, moved, rotation_angle, transform_points
from grasptransfer.perception.arrangement import arrange
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.picture_evidence import LatentPrior, Motion, PictureEvidence
from grasptransfer.perception.picture_lists import observe_all
from grasptransfer.perception.pose_and_shape import PoseAndShape, fit_pose_and_shape
from grasptransfer.perception.several_pictures import COMMON, share_of_new, weights_of
from grasptransfer.perception.standing import Standing, Support, contacts
from grasptransfer.poses import covariance_of
from grasptransfer.registration import DisplacementModel

CAMERA = Camera.from_fov(256, 192, np.deg2rad(40))
PICTURE = np.zeros((192, 256, 3), np.uint8)
SIDES = (0.2, 1.0, 2.4)  # azimuths of the cameras [rad]
MODES = 4


def _ball(seed: int):
    """Points of a 10 cm ball, a smooth linear shape model, and a latent."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    basis = np.stack([points @ rng.normal(0, 0.1, (3, 3)) for _ in range(MODES)], axis=-1)
    model = DisplacementModel(points @ rng.normal(0, 0.02, (3, 3)), basis)
    return rng, points, model, rng.normal(size=MODES)


def _evidence(rng, points, model, latent, pose) -> PictureEvidence:
    """What a picture from this pose shows, with errors of its own."""
    offsets = model.at(latent) + rng.normal(0, 0.001, points.shape)
    pixels = CAMERA.project(transform_points(pose, points + model.at(latent))) + rng.normal(0, 0.3, (200, 2))
    motion = Motion(offsets, np.full(200, 0.002), pixels, np.full(200, 0.5))
    said = LatentPrior(latent + rng.normal(0, 0.3, MODES), np.full(MODES, 0.4))
    return PictureEvidence(motion, points, model, CAMERA, latent=said)


def _fit(given_poses, evidence, views="moved camera", pose_sigma=None) -> PoseAndShape:
    sigma = covariance_of(pose_sigma)
    first, *further = (Observation(PICTURE, CAMERA, pose, pose_covariance=sigma) for pose in given_poses)
    start = arrange(replace(first, further=tuple(further), views=views), evidence[0].points, refine=True)
    return fit_pose_and_shape(
        evidence, start.start, start.priors, places=start.places, overconfidence=start.overconfidence
    )


def _sides(seed: int, azimuths=SIDES):
    """True poses, given poses with one error common to all, and what the pictures show."""
    rng, points, model, latent = _ball(seed)
    poses = [look_at(0.5, azimuth, 0.5) for azimuth in azimuths]
    wrong = moved(poses[0], rng.normal(0, [0.03] * 3 + [0.005] * 3))
    given_poses = [pose @ invert(poses[0]) @ wrong for pose in poses]
    return poses, given_poses, [_evidence(rng, points, model, latent, pose) for pose in poses], latent


@given(st.integers(0, 500))
@settings(max_examples=10, deadline=None)
def test_the_order_of_the_pictures_changes_nothing(seed):
    poses, given_poses, evidence, _ = _sides(seed)
    # One prior for all: by default it lies along the ray of the first camera.
    first = _fit(given_poses, evidence, pose_sigma=(0.01, 2))
    order = [2, 0, 1]
    other = _fit([given_poses[i] for i in order], [evidence[i] for i in order], pose_sigma=(0.01, 2))
    np.testing.assert_allclose(first.latent, other.latent, atol=2e-2)
    from_first = poses[2] @ invert(poses[0]) @ first.camera_from_object
    np.testing.assert_allclose(from_first, other.camera_from_object, atol=2e-3)


@pytest.mark.parametrize("views", ["moved camera", "separate"])
def test_two_copies_of_a_picture_say_what_one_says(views):
    _, given_poses, evidence, _ = _sides(3)
    one = _fit(given_poses[:1], evidence[:1])
    two = _fit([given_poses[0]] * 2, [evidence[0]] * 2, views)
    np.testing.assert_allclose(two.latent, one.latent, atol=1e-6)
    np.testing.assert_allclose(two.covariance, one.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(two.camera_from_object, one.camera_from_object, atol=1e-9)


def test_more_sides_leave_less_unknown():
    _, given_poses, evidence, _ = _sides(4)
    traces = [np.trace(_fit(given_poses[:n], evidence[:n]).covariance[6:, 6:]) for n in (1, 2, 3)]
    assert traces[0] > traces[1] > traces[2]


def test_two_sides_find_the_distance_that_one_cannot():
    off = []
    for count in (1, 2):
        for seed in range(5):
            poses, _, evidence, _ = _sides(seed)
            farther = moved(poses[0], np.array([0, 0, 0, 0, 0, 0.04]))
            given_poses = [pose @ invert(poses[0]) @ farther for pose in poses]
            fit = _fit(given_poses[:count], evidence[:count], pose_sigma=(0.03, 2))
            off.append(np.linalg.norm(fit.camera_from_object[:3, 3] - poses[0][:3, 3]))
    assert np.mean(off[5:]) < 0.5 * np.mean(off[:5])


def test_separate_poses_that_agree_give_what_a_moved_camera_gives():
    poses, _, evidence, latent = _sides(5)
    moved_camera, separate = (_fit(poses, evidence, views) for views in ("moved camera", "separate"))
    # Both lie within the errors of the pictures (a cell errs by 1 mm), which weigh a little differently.
    np.testing.assert_allclose(separate.latent, moved_camera.latent, atol=0.15)
    turned = separate.camera_from_object[:3, :3] @ moved_camera.camera_from_object[:3, :3].T
    assert rotation_angle(turned) < np.deg2rad(1)
    assert np.linalg.norm((separate.camera_from_object - moved_camera.camera_from_object)[:3, 3]) < 3e-3
    np.testing.assert_allclose(separate.latent, latent, atol=0.4)


def test_separate_poses_are_each_put_right():
    poses, _, evidence, _ = _sides(6)
    rng = np.random.default_rng(0)
    wrong = [moved(pose, rng.normal(0, [0.08] * 3 + [0.004] * 3)) for pose in poses]
    fit = _fit(wrong, evidence, "separate", pose_sigma=(0.02, 15))
    assert len(fit.poses) == 3
    for true, given_pose, found in zip(poses, wrong, fit.poses, strict=True):
        before, after = (rotation_angle(one[:3, :3] @ true[:3, :3].T) for one in (given_pose, found))
        assert after < 0.7 * before


def test_weights_are_those_of_the_best_mean():
    along, across = np.array([1.0, 0, 0]), np.array([0.0, 0, 1.0])
    assert weights_of(along[None]).tolist() == [1.0]
    np.testing.assert_allclose(weights_of(np.stack([along] * 3)), [1 / 3] * 3, atol=1e-9)
    aside = np.array([np.cos(0.2), np.sin(0.2), 0.0])
    sums = [weights_of(np.stack([along, other])).sum() for other in (along, aside, -along, across)]
    # The same side, nearly the same, its mirror image, and the farthest from both.
    assert sums == sorted(sums)
    assert sums[-1] < 2 / (1 + COMMON)
    assert share_of_new(along[None], along[None]) < 0.01 < share_of_new(along[None], across[None]) < 1


def test_a_plane_says_how_far_the_object_is():
    _, points, model, latent = _ball(8)
    pose = look_at(0.5, 0.3, 0.9)
    shaped = model.displaced(points, latent)
    up = pose[:3, 2]
    lowest = shaped[np.argmin(shaped[:, 2])]
    support = Support(pose[:3, :3] @ lowest + pose[:3, 3], up, 0.001)
    evidence = _evidence(np.random.default_rng(0), points, model, latent, pose)
    farther = pose.copy()
    farther[2, 3] += 0.03
    start = arrange(Observation(PICTURE, CAMERA, farther), points, refine=True)
    off = []
    for standing in (None, Standing(support, points, model)):
        fit = fit_pose_and_shape([evidence], start.start, start.priors, standing=standing)
        off.append(abs(fit.camera_from_object[2, 3] - pose[2, 3]))
    assert off[1] < 0.5 * off[0]


def test_a_box_stands_on_the_corners_of_its_bottom_however_it_leans():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-2, 2)], float)
    for lean in (0.0, 0.2):
        down = np.array([np.sin(lean), 0, -np.cos(lean)])
        np.testing.assert_array_equal(np.sort(contacts(corners, down)), np.flatnonzero(corners[:, 2] < 0))


POSE = look_at(0.5, 0.3, 0.5)
SMALL = Camera.from_fov(128, 96, 1.0)


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        ({"image": []}, ImageError, ("image", "no picture")),
        ({"pose": [POSE]}, PoseError, ("pose", "list of 2", "1 of them")),
        ({"pose": POSE}, PoseError, ("pose", "list of 2")),
        ({"box": [(1, 2, 30, 40)]}, ImageError, ("box", "list of 2", "1 of them")),
        ({"mask": np.ones((192, 256), bool)}, ImageError, ("mask", "list of 2")),
        ({"depth": [None] * 3}, ImageError, ("depth", "3 of them")),
        ({"camera": [CAMERA]}, CameraError, ("camera", "list of 2", "1 of them")),
        ({"views": "video"}, SettingsError, ("views", "video", "moved camera, separate")),
        ({"pose": [POSE, np.zeros((4, 4))]}, PoseError, ("pose[1]",)),
        ({"image": [PICTURE, PICTURE[:96, :128]]}, CameraError, ("camera", "256 x 192", "128 x 96")),
        ({"image": [PICTURE, PICTURE[:96, :128]], "camera": None}, CameraError, ("different sizes",)),
        ({"image": [PICTURE, PICTURE[:96, :128]], "camera": [CAMERA] * 2}, ImageError, ("image[1]", "size")),
        ({"pose_sigma": [None, (-1, 2)]}, PoseError, ("pose_sigma[1]",)),
    ],
)
def test_wrong_lists_are_refused_by_argument_value_and_choices(arguments, kind, words):
    right = {"image": [PICTURE, PICTURE], "pose": [POSE, POSE], "camera": CAMERA}
    with pytest.raises(GraspTransferError) as caught:
        observe_all(**(right | arguments))
    assert type(caught.value) is kind
    for word in words:
        assert word in str(caught.value)


def test_pictures_of_different_sizes_come_with_their_cameras():
    seen = observe_all(
        [PICTURE, PICTURE[:96, :128]], [POSE, POSE], camera=[CAMERA, SMALL], pose_sigma=(0.01, 2)
    )
    assert [picture.camera for picture in seen.pictures] == [CAMERA, SMALL]
    assert all(picture.pose_covariance is not None for picture in seen.pictures)
    own = observe_all([PICTURE] * 2, [POSE] * 2, camera=CAMERA, pose_sigma=[0, None])
    assert own.pictures[1].pose_covariance is None


def test_a_list_of_one_picture_is_one_picture():
    alone, listed = observe_all(PICTURE, POSE, camera=CAMERA), observe_all([PICTURE], [POSE], camera=CAMERA)
    assert listed.further == alone.further == ()
    np.testing.assert_array_equal(listed.camera_from_object, alone.camera_from_object)
