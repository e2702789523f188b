"""Shape spaces: laws of probabilistic PCA, and displacements under the prior."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptransfer.errors import FieldFileError, PointCloudError, SettingsError
from grasptransfer.registration import DeformationField, EmSettings, ShapeSpace
from grasptransfer.registration.clouds import Normaliser
from grasptransfer.registration.kernels import gaussian
from grasptransfer.registration.ppca import fit_closed, fit_em

METRICS = ["GW", "G", "W"]
BETA = 1.0


def control(count: int = 40) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, 3)) * 0.05


def training(instances: int = 8, modes: int = 3, *, seed: int = 0, noise: float = 0.0) -> np.ndarray:
    """Weights of fields that differ along a few smooth modes."""
    rng, points = np.random.default_rng(seed), control()
    shapes = [points * np.eye(3)[axis] * 0.3 for axis in range(3)] + [0.02 * np.sin(30 * points[:, ::-1])]
    weights = []
    for _ in range(instances):
        moved = points + sum(rng.normal() * shape for shape in shapes[:modes])
        moved += noise * rng.normal(size=points.shape)
        weights.append(DeformationField.fit(points, points, moved, beta=BETA).weights)
    return np.stack(weights)


def learn(weights=None, **options) -> ShapeSpace:
    points = control()
    normaliser = Normaliser.of(points)
    weights = training() if weights is None else weights
    return ShapeSpace.fit(weights, points, BETA, normaliser.centre, normaliser.scale, **options)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("em", [None, EmSettings()], ids=["closed", "em"])
def test_decode_after_encode_returns_the_training_fields_at_full_rank(metric, em):
    weights = training(6)
    space = learn(weights, n_modes=5, metric=metric, em=em)
    points = control()
    for one in weights:
        given_field = DeformationField(points, one, BETA, space.centre, space.scale)
        found = space.field(space.encode(one))
        moved = np.abs(given_field.displacement(points)).max()
        # Modes that hold nothing but rounding are drawn to zero by the noise floor.
        assert np.abs(found(points) - given_field(points)).max() < 1e-4 * moved


@pytest.mark.parametrize("metric", METRICS)
@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_encode_after_decode_is_the_identity(metric, seed):
    space = learn(n_modes=3, metric=metric)
    latent = np.random.default_rng(seed).normal(size=3)
    # The three modes hold all variance but rounding, so the noise that shrinks is near zero.
    np.testing.assert_allclose(space.encode(space.decode(latent)), latent, atol=1e-4)


@pytest.mark.parametrize("metric", METRICS)
def test_em_finds_what_the_closed_form_finds(metric):
    weights = training(noise=0.001)
    closed, em = (learn(weights, n_modes=3, metric=metric, em=one) for one in (None, EmSettings()))
    np.testing.assert_allclose(em.variances, closed.variances, rtol=1e-4)
    # Weights of noise are the least settled part of the metric W; 1 % of the noise.
    assert em.noise_variance == pytest.approx(closed.noise_variance, rel=1e-2)
    points = control()
    for mode in range(3):
        a, b = (space.field(np.eye(3)[mode] * 2.0)(points) for space in (closed, em))
        c = em.field(-np.eye(3)[mode] * 2.0)(points)  # the sign of a mode is free
        assert min(np.abs(a - b).max(), np.abs(a - c).max()) < 1e-4


def test_the_closed_form_is_the_maximum_of_the_likelihood():
    rng = np.random.default_rng(0)
    features = rng.normal(size=(30, 4)) @ np.diag([3.0, 2.0, 0.5, 0.5])
    closed = fit_closed(features, 2)
    loading = closed.combinations @ (features - features.mean(0))

    def likelihood(loading, noise):
        covariance = loading.T @ loading + noise * np.eye(4)
        sample = np.cov(features.T, bias=True)
        return -np.linalg.slogdet(covariance)[1] - np.trace(np.linalg.solve(covariance, sample))

    best = likelihood(loading, closed.noise_variance)
    for _ in range(50):
        nearby = likelihood(
            loading + 0.02 * rng.normal(size=loading.shape),
            closed.noise_variance * np.exp(0.05 * rng.normal()),
        )
        assert nearby < best


def test_em_recovers_a_model_from_data_with_gaps():
    rng = np.random.default_rng(1)
    true = rng.normal(size=(2, 12)) * [[3.0], [1.5]]
    latents = rng.normal(size=(400, 2))
    features = 5 + latents @ true + 0.1 * rng.normal(size=(400, 12))
    observed = rng.random(features.shape) > 0.3
    broken = np.where(observed, features, 1e6)  # must never be looked at
    em = fit_em(broken, 2, observed=observed)
    covariance = em.loading.T @ em.loading
    expected = true.T @ true
    # 400 samples: standard errors of a few per cent of the largest variance.
    assert np.abs(covariance - expected).max() < 0.15 * np.abs(expected).max()
    assert em.noise_variance == pytest.approx(0.01, rel=0.1)
    # A quarter of each column is missing; its mean is known through the other columns.
    np.testing.assert_allclose(em.mean, features.mean(0), atol=0.05)


def test_unbelieved_weights_are_never_looked_at():
    weights = training(10)
    observed = np.ones(weights.shape[:2], bool)
    observed[3, :8] = False
    found = []
    for garbage in (0.0, 1e6):
        weights[3, :8] = garbage
        found.append(learn(weights, n_modes=3, metric="W", em=EmSettings(observed)))
    assert np.array_equal(found[0].mean, found[1].mean)
    assert np.array_equal(found[0].basis, found[1].basis)


def test_unbelieved_displacements_leave_a_smooth_space_near_the_true_one():
    weights, points = training(10, noise=0.0005), control()
    observed = np.random.default_rng(0).random(weights.shape[:2]) > 0.2
    full = learn(weights, n_modes=3, em=EmSettings())
    partial = learn(weights, n_modes=3, em=EmSettings(observed))
    between = np.random.default_rng(1).normal(size=(50, 3)) * 0.05
    for where in (points, between):
        miss = partial.displacement_model(where).mean - full.displacement_model(where).mean
        moved = full.displacement_model(where).basis
        # A fifth of the entries are gone: the mean stays within a tenth of a typical deformation.
        assert np.linalg.norm(miss) < 0.1 * np.linalg.norm(moved)


def test_modes_are_orthogonal_in_the_metric_and_as_long_as_their_variance():
    weights = training(8, 4, noise=0.002)
    points = Normaliser.of(control())(control())
    kernel = gaussian(points, points, BETA)
    seen = {"W": np.eye(len(kernel)), "GW": kernel, "G": np.linalg.cholesky(kernel + 1e-12 * np.eye(40)).T}
    for metric in METRICS:
        space = learn(weights, n_modes=3, metric=metric)
        features = np.stack([(seen[metric] @ mode).ravel() for mode in space.basis])
        expected = np.diag(space.variances - space.noise_variance)
        # The factor of G that the space uses is good to 1e-10; weights reach some hundreds.
        np.testing.assert_allclose(features @ features.T, expected, atol=1e-5 * space.variances[0])


def test_the_displacement_model_is_the_field():
    space = learn(n_modes=3)
    points = np.random.default_rng(5).normal(size=(70, 3)) * 0.05
    model = space.displacement_model(points)
    latent = np.array([0.5, -1.0, 2.0])
    np.testing.assert_allclose(model.at(latent), space.field(latent).displacement(points), atol=1e-9)
    np.testing.assert_allclose(model.mean, space.field().displacement(points), atol=1e-9)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_exact_displacements_give_the_latent_back(seed):
    space, rng = learn(n_modes=3), np.random.default_rng(seed)
    latent, points = rng.normal(size=3), rng.normal(size=(30, 3)) * 0.05
    posterior = space.map_estimate(points, space.field(latent).displacement(points), 1e-7)
    np.testing.assert_allclose(posterior.mean, latent, atol=1e-3)  # the prior weighs 1e-7 of the data
    assert posterior.residual_rms < 1e-6


def test_without_points_the_posterior_is_the_prior():
    space = learn(n_modes=3)
    posterior = space.map_estimate(np.zeros((0, 3)), np.zeros((0, 3)), 0.001)
    np.testing.assert_array_equal(posterior.mean, np.zeros(3))
    np.testing.assert_array_equal(posterior.covariance, np.eye(3))
    assert posterior.residual_rms == 0.0


def test_the_posterior_is_calibrated():
    """The true latent lies within the posterior's spread as often as it should."""
    space, rng = learn(n_modes=3), np.random.default_rng(0)
    points = control()[:4]
    normalised = []
    for _ in range(300):
        latent = space.sample(rng)
        seen = space.field(latent).displacement(points) + 0.01 * rng.normal(size=(4, 3))
        posterior = space.map_estimate(points, seen, 0.01)
        normalised.append(np.linalg.solve(np.linalg.cholesky(posterior.covariance), latent - posterior.mean))
    normalised = np.array(normalised)
    # 900 standard normal numbers: mean 0 +- 0.033, variance 1 +- 0.047; four of these each.
    assert abs(normalised.mean()) < 0.14
    assert abs(normalised.var() - 1) < 0.19


def test_points_with_less_noise_count_more():
    space = learn(n_modes=3)
    points = control()[:2]
    seen = np.stack([space.field(np.ones(3)).displacement(points[:1])[0], np.array([0.1, 0.1, 0.1])])
    trusting = space.map_estimate(points, seen, np.array([1e-4, 1.0]))
    miss = space.displacement_model(points).at(trusting.mean)[0]
    np.testing.assert_allclose(miss, seen[0], atol=1e-3)


def test_samples_of_the_posterior_have_its_moments():
    space = learn(n_modes=3)
    posterior = space.map_estimate(control()[:3], np.full((3, 3), 0.005), 0.01)
    drawn = posterior.sample(np.random.default_rng(0), 20_000)
    # 20,000 samples: four standard errors.
    np.testing.assert_allclose(drawn.mean(0), posterior.mean, atol=0.03)
    np.testing.assert_allclose(np.cov(drawn.T), posterior.covariance, atol=0.04)


def test_the_same_seed_gives_the_same_sample():
    space = learn(n_modes=3)
    a, b = (space.sample(np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(a, b)


def test_a_stranger_scores_worse_than_a_member():
    weights = training(12, noise=0.0005)
    space = learn(weights, n_modes=3)
    member = space.score(weights[0])
    points = control()
    stranger = space.score(
        DeformationField.fit(points, points, points[:, [1, 2, 0]] * [2, -1, 3], beta=BETA).weights
    )
    assert stranger.residual_rms > 10 * member.residual_rms
    assert member.mahalanobis < 3


def test_interpolation_goes_from_one_shape_to_the_other():
    space, points = learn(n_modes=3), control()
    a, b = np.array([1.0, 0, -1]), np.array([-1.0, 2, 0])
    ends = space.field(a)(points), space.field(b)(points)
    np.testing.assert_allclose(space.interpolate(a, b, 0.0)(points), ends[0], atol=1e-12)
    np.testing.assert_allclose(space.interpolate(a, b, 1.0)(points), ends[1], atol=1e-12)
    np.testing.assert_allclose(
        space.interpolate(a, b, 0.25)(points), 0.75 * ends[0] + 0.25 * ends[1], atol=1e-12
    )


def test_the_number_of_modes_can_follow_the_variance():
    assert learn(training(10, 3)).n_modes == 3


def test_identical_instances_give_a_space_that_does_not_move():
    space = learn(np.repeat(training(1), 4, axis=0), n_modes=2)
    assert np.abs(space.basis).max() < 1e-9
    assert np.isfinite(space.encode(space.mean)).all()


def test_a_saved_space_is_the_same(tmp_path):
    space = learn(n_modes=3, metric="G")
    space.save(tmp_path / "space.npz")
    loaded = ShapeSpace.load(tmp_path / "space.npz")
    latent = np.array([1.0, -1, 0.5])
    assert loaded.metric == "G"
    assert np.array_equal(loaded.decode(latent), space.decode(latent))
    assert np.array_equal(loaded.encode(loaded.mean), space.encode(space.mean))


def test_a_field_is_no_shape_space(tmp_path):
    DeformationField.identity(control()).save(tmp_path / "field.npz")
    with pytest.raises(FieldFileError, match="shape space"):
        ShapeSpace.load(tmp_path / "field.npz")


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"n_modes": 8}, "n_modes"),
        ({"n_modes": 0}, "n_modes"),
        ({"em": EmSettings(np.ones((8, 40), bool)), "metric": "G"}, "observed"),
    ],
)
def test_impossible_options_are_refused_by_name(options, name):
    with pytest.raises(SettingsError, match=name):
        learn(**options)


@pytest.mark.parametrize("weights", [np.zeros((1, 40, 3)), np.full((4, 40, 3), np.nan)])
def test_impossible_weights_are_refused(weights):
    with pytest.raises(PointCloudError, match="weights"):
        learn(weights)


@pytest.mark.parametrize("latent", [np.zeros(2), np.full(3, np.nan)])
def test_impossible_latents_are_refused(latent):
    with pytest.raises(SettingsError, match="latent"):
        learn(n_modes=3).field(latent)


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan])
def test_impossible_noise_is_refused(noise):
    with pytest.raises(SettingsError, match="noise_std"):
        learn(n_modes=3).map_estimate(control()[:2], np.zeros((2, 3)), noise)
