"""Shape space and pose fitted to clouds: derivatives, recovery, visibility, failure."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from grasptransfer.errors import NotSucceeded, PointCloudError, PoseError
from grasptransfer.frames import rigid
from grasptransfer.registration import (
    DeformationField,
    DisplacementModel,
    GaussianPosePrior,
    LatentFitStatus,
    Matching,
    PreparedSource,
    ShapeSpace,
    latent_fit,
)
from grasptransfer.registration.fit_residuals import FitResiduals, Posed
from grasptransfer.registration.visibility import visible_points


def cup(count: int, seed: int) -> np.ndarray:
    """A can of 8 x 8 x 10 cm with a bulge on one side, so that its pose is seen."""
    rng = np.random.default_rng(seed)
    angle, height = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.05, 0.05, count)
    radius = 0.04 + 0.025 * np.exp(-np.square(np.angle(np.exp(1j * angle)) / 0.4) - np.square(height / 0.03))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def shaped(points: np.ndarray, latent) -> np.ndarray:
    """Three ways in which cups differ: height, width, and how far the bulge sticks out."""
    tall, wide, bulge = latent
    out = np.exp(-np.square((points - [0.065, 0, 0]) / 0.03).sum(1))[:, None]
    return points * (1 + np.array([0.15 * wide, 0.15 * wide, 0.2 * tall])) + 0.012 * bulge * out * [1, 0, 0]


@pytest.fixture(scope="module")
def space() -> ShapeSpace:
    source = PreparedSource(cup(400, 0), beta=1.0)
    rng = np.random.default_rng(1)
    weights = [
        DeformationField.fit(source.points, source.points, shaped(source.points, latent), beta=1.0).weights
        for latent in rng.normal(size=(20, 3))
    ]
    normaliser = source.normaliser
    return ShapeSpace.fit(
        np.stack(weights), source.points, 1.0, normaliser.centre, normaliser.scale, n_modes=3
    )


def dense(space: ShapeSpace, latent, *, seed: int = 5) -> np.ndarray:
    """Another sample of the surface of the space's own shape."""
    return space.field(latent)(cup(800, seed))


def error(fit, space: ShapeSpace, truth: np.ndarray) -> float:
    """RMS distance of corresponding points [m], told object frame."""
    points, pose = cup(800, 5), fit.given_from_refined
    found = space.field(fit.latent)(points) @ pose[:3, :3].T + pose[:3, 3]
    return float(np.sqrt(np.square(found - truth).sum(1).mean()))


LATENTS = [np.zeros(3), np.array([1.5, -1.0, 0.5]), np.array([-1.0, 1.5, 1.0])]


@pytest.mark.parametrize("latent", LATENTS)
def test_a_full_cloud_gives_its_shape_back(space, latent):
    truth = dense(space, latent)
    # Nearest points jump from step to step: one of these takes SciPy 1.15 54 steps, and 1.17 twelve.
    fit = latent_fit(space, truth, model_points=cup(1500, 9), matching=Matching(max_iterations=100))
    assert fit.status is LatentFitStatus.CONVERGED
    # The model's points are 4 mm apart, the cloud's others.
    assert error(fit, space, truth) < 0.001


@pytest.mark.parametrize("latent", LATENTS)
def test_shape_and_pose_are_found_together(space, latent):
    told_from_object = rigid(
        Rotation.from_rotvec([0.06, -0.08, 0.1]).as_matrix(), np.array([0.01, -0.012, 0.008])
    )
    truth = dense(space, latent) @ told_from_object[:3, :3].T + told_from_object[:3, 3]
    fit = latent_fit(space, truth, model_points=cup(1500, 9), refine_pose=True)
    assert error(fit, space, truth) < 0.0015
    kept = latent_fit(space, truth, model_points=cup(1500, 9))
    assert np.array_equal(kept.given_from_refined, np.eye(4))
    assert error(kept, space, truth) > 3 * error(fit, space, truth)


def test_an_initial_pose_reaches_what_a_refinement_cannot(space):
    told_from_object = rigid(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.array([0.3, 0, 0]))
    truth = dense(space, LATENTS[1]) @ told_from_object[:3, :3].T + told_from_object[:3, 3]
    near = rigid(Rotation.from_euler("z", 84, degrees=True).as_matrix(), np.array([0.295, 0.004, 0]))
    fit = latent_fit(space, truth, model_points=cup(1500, 9), initial_pose=near, refine_pose=True)
    assert error(fit, space, truth) < 0.0015


def seen_from(points: np.ndarray, viewpoint: np.ndarray) -> np.ndarray:
    return points[visible_points(points, viewpoint)]


def test_a_partial_cloud_gives_the_hidden_side(space):
    truth = dense(space, LATENTS[1])
    viewpoint = np.array([0.3, -0.5, 0.2])
    partial = seen_from(truth, viewpoint)
    assert len(partial) < 0.6 * len(truth)
    fit = latent_fit(space, partial, model_points=cup(1500, 9), viewpoint=viewpoint)
    undeformed = np.sqrt(np.square(cup(800, 5) - truth).sum(1).mean())
    assert error(fit, space, truth) < 0.3 * undeformed


def test_fewer_points_leave_a_larger_variance(space):
    truth = dense(space, LATENTS[1])
    variances = [np.trace(latent_fit(space, truth[::step]).covariance) for step in (1, 8, 64)]
    assert variances == sorted(variances)
    assert variances[-1] < 3  # and never more than the prior's


def test_far_outliers_are_ignored(space):
    truth = dense(space, LATENTS[1])
    stray = np.random.default_rng(0).normal(size=(40, 3)) * 0.05 + [0.3, 0.3, 0]
    clean = latent_fit(space, truth, model_points=cup(1500, 9))
    polluted = latent_fit(space, np.concatenate([truth, stray]), model_points=cup(1500, 9))
    assert error(clean, space, truth) < 0.001
    assert error(polluted, space, truth) < 0.003


@settings(max_examples=15)
@given(
    seed=st.integers(0, 10_000),
    refine=st.booleans(),
    covered=st.booleans(),
    sliding=st.sampled_from([0.0, 0.7]),
)
def test_the_jacobian_is_that_of_finite_differences(seed, refine, covered, sliding):
    rng = np.random.default_rng(seed)
    model = rng.normal(size=(30, 3)) * 0.05
    posed = Posed(
        model,
        DisplacementModel(rng.normal(size=(30, 3)) * 0.01, rng.normal(size=(30, 3, 2)) * 0.01),
        rigid(Rotation.random(rng=seed).as_matrix(), rng.normal(size=3)),
        GaussianPosePrior() if refine else None,
    )
    state = rng.normal(size=len(posed.start())) * 0.3
    observed = posed.points(state) + rng.normal(size=(30, 3)) * 0.002
    visible = rng.random(30) > 0.5 if covered else None
    residuals = FitResiduals(posed, observed, 0.004, 1.5, visible, sliding)
    step = 1e-7
    columns = []
    matches = residuals._matches(state)[1]
    for axis in np.eye(len(state)):
        ahead, behind = residuals.values(state + step * axis), residuals.values(state - step * axis)
        if not np.array_equal(residuals._matches(state + step * axis)[1], matches):
            return  # a nearest point changed just here, where no derivative exists
        columns.append((ahead - behind) / (2 * step))
    expected = np.stack(columns, axis=1)
    # Rounding of values of some hundreds, divided by the step.
    np.testing.assert_allclose(
        residuals.jacobian(state), expected, atol=1e-5 * max(1, np.abs(expected).max())
    )


def test_it_fits_no_worse_than_nearest_points_alone(space):
    """Against the predecessor's objective: nearest-point distance, no prior, from the mean shape."""
    model = space.control_points
    displacement = space.displacement_model(model)
    for latent in LATENTS:
        cloud = dense(space, latent)

        def distances(x, cloud=cloud):
            return KDTree(displacement.displaced(model, x)).query(cloud)[0]

        theirs = np.square(distances(least_squares(distances, np.zeros(3)).x)).mean()
        ours = np.square(
            distances(latent_fit(space, cloud, matching=Matching(100.0, sliding=0.0)).latent)
        ).mean()
        assert ours < 1.01 * theirs  # the prior may cost a little where the optimum is the same


def test_visible_points_of_a_sphere_are_its_near_cap():
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(2000, 3))
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    visible = visible_points(sphere, np.array([3.0, 0, 0]))
    truly = sphere[:, 0] > 1 / 3  # tangents from a distance of 3 radii
    # The method errs near the rim only.
    assert (visible == truly)[np.abs(sphere[:, 0] - 1 / 3) > 0.25].mean() > 0.98


def test_a_flat_cloud_hides_nothing():
    flat = np.random.default_rng(0).normal(size=(50, 3)) * [1, 1, 0]
    assert visible_points(flat, np.array([0, 0, 0.0])).all()
    assert visible_points(flat, np.array([5.0, 0, 0])).all()


def test_a_cloud_of_something_else_is_a_poor_fit(space):
    far = cup(300, 0) * [6.0, 0.3, 4.0]
    fit = latent_fit(space, far)
    assert fit.status is LatentFitStatus.POOR_FIT
    with pytest.raises(NotSucceeded, match="category"):
        latent_fit(space, far, strict=True)


def test_the_iteration_limit_is_reported(space):
    fit = latent_fit(space, dense(space, LATENTS[2]), matching=Matching(max_iterations=2))
    assert fit.status is LatentFitStatus.ITERATION_LIMIT


def test_each_status_has_one_sentence_of_advice():
    for status in LatentFitStatus:
        assert status.advice.endswith(".")
        assert status.advice.count(".") == 1


def test_the_same_cloud_gives_the_same_fit(space):
    cloud = dense(space, LATENTS[1])
    a, b = (latent_fit(space, cloud, refine_pose=True) for _ in range(2))
    assert np.array_equal(a.latent, b.latent)
    assert np.array_equal(a.given_from_refined, b.given_from_refined)


@pytest.mark.parametrize(
    "cloud",
    [np.zeros((0, 3)), np.zeros((5, 3)), np.full((5, 3), np.nan), np.zeros((5, 2)), np.ones((1, 3))],
)
def test_bad_clouds_are_refused_by_name(space, cloud):
    with pytest.raises(PointCloudError, match="points_object"):
        latent_fit(space, cloud)


def test_a_reflection_is_no_pose(space):
    with pytest.raises(PoseError, match="reflection"):
        latent_fit(space, dense(space, LATENTS[0]), initial_pose=np.diag([1.0, 1, -1, 1]))
