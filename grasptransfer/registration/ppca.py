"""Probabilistic PCA: f = mean + loading x + noise, x ~ N(0, I), noise ~ N(0, noise_variance I).

| symbol | name |
| --- | --- |
| t, one training vector | row of `features` (i, d) |
| mu | `mean` (d,) |
| Lambda, factor loading | `loading` (k, d), rows orthogonal, longest first |
| sigma^2 | `noise_variance` |

Source: Tipping and Bishop, Probabilistic Principal Component Analysis, 1999: closed form eq. 7-8,
EM appendix B; missing data as each vector's marginal over what was observed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.errors import SettingsError

EM_ITERATIONS = 500
EM_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """The modes as combinations of the training vectors, so that they never need to be formed.

    Args:
        combinations: (k, i) loading = combinations @ (features - mean).
        variances: (k,) variance of the data along each mode.
        noise_variance: mean variance of the directions left out.
    """

    combinations: Float[np.ndarray, "k i"]
    variances: Float[np.ndarray, "k"]
    noise_variance: float


@dataclass(frozen=True, eq=False)
class ExpectationMaximisation:
    """Result of `fit_em`: the model itself.

    Args:
        mean: (d,) mean of the data.
        loading: (k, d) modes, one standard deviation long, longest first.
        variances: (k,) variance of the data along each mode.
        noise_variance: variance, in each entry, of what the modes leave out.
    """

    mean: Float[np.ndarray, "d"]
    loading: Float[np.ndarray, "k d"]
    variances: Float[np.ndarray, "k"]
    noise_variance: float


def count_modes(features: Float[np.ndarray, "i d"], n_modes: int | None) -> int:
    """`n_modes`, or the fewest modes that hold 99 % of the variance.

    Raises:
        SettingsError: more modes than the instances allow.
    """
    most = min(len(features) - 1, features.shape[1])
    if n_modes is None:
        share = np.cumsum(fit_closed(features, most).variances)
        return int(np.searchsorted(share, 0.99 * share[-1]) + 1) if share[-1] > 0 else 1
    if not 1 <= n_modes <= most:
        raise SettingsError(
            f"must be between 1 and {most}, one less than the instances", key="n_modes", value=n_modes
        )
    return int(n_modes)


def fit_closed(features: Float[np.ndarray, "i d"], n_modes: int) -> ClosedForm:
    """Maximum likelihood in closed form, by the Gram matrix of the few training vectors.

    Args:
        features: (i, d) training vectors.
        n_modes: k, as of `count_modes`.
    """
    count, size = features.shape
    centred = features - features.mean(0)
    variances, vectors = np.linalg.eigh(centred @ centred.T / count)
    variances, vectors = np.maximum(variances[::-1], 0.0), vectors[:, ::-1]
    left_out = float(variances[n_modes:].sum() / max(size - n_modes, 1))
    kept = variances[:n_modes]
    with np.errstate(divide="ignore", invalid="ignore"):
        stretch = np.where(kept > 0, np.sqrt(np.maximum(kept - left_out, 0.0) / (count * kept)), 0.0)
    combinations = (vectors[:, :n_modes] * stretch).T
    signs = np.sign(combinations[np.arange(n_modes), np.abs(combinations).argmax(1)])
    return ClosedForm(combinations * np.where(signs == 0, 1, signs)[:, None], kept, left_out)


def fit_em(
    features: Float[np.ndarray, "i d"],
    n_modes: int,
    *,
    observed: Bool[np.ndarray, "i d"] | None = None,
    seed: int = 0,
) -> ExpectationMaximisation:
    """Maximum likelihood by EM.

    Args:
        features: (i, d) training vectors.
        n_modes: k, as of `count_modes`.
        observed: (i, d) entries to believe; the others do not count. None: all of them.
        seed: seed of the first guess.
    """
    size = features.shape[1]
    seen = np.ones_like(features) if observed is None else observed.astype(float)
    features = np.where(seen > 0, features, 0.0)
    times_seen = np.maximum(seen.sum(0), 1)
    mean = features.sum(0) / times_seen
    spread = np.sqrt(np.square((features - mean) * seen).sum() / seen.sum())
    loading = np.random.default_rng(seed).normal(size=(n_modes, size)) * spread
    noise = spread**2
    floor = 1e-12 * noise + np.finfo(float).tiny
    for _ in range(EM_ITERATIONS):
        latents, covariances = _expect((features - mean) * seen, loading, seen, noise)
        outer = latents[:, :, None] * latents[:, None, :] + covariances
        normal = np.einsum("id,ikl->dkl", seen, outer)
        normal += floor * np.eye(n_modes)
        moment = np.einsum("ik,id->dk", latents, (features - mean) * seen)
        previous, loading = loading, np.linalg.solve(normal, moment[:, :, None])[:, :, 0].T
        residual = (features - mean - latents @ loading) * seen
        unsure = np.einsum("id,kd,ikl,ld->", seen, loading, covariances, loading, optimize=True)
        noise = max(float((np.square(residual).sum() + unsure) / seen.sum()), floor)
        mean = mean + residual.sum(0) / times_seen
        # Parameter expansion (Liu, Rubin, Wu 1998): give the latents unit covariance at once; plain
        # EM takes about variance / noise steps to get there.
        middle = latents.mean(0)
        mean = mean + middle @ loading
        loading = np.linalg.cholesky(outer.mean(0) - np.outer(middle, middle)).T @ loading
        if np.abs(loading - previous).max() < EM_TOLERANCE * np.abs(loading).max():
            break
    _, stretch, directions = np.linalg.svd(loading, full_matrices=False)
    return ExpectationMaximisation(mean, stretch[:, None] * directions, stretch**2 + noise, noise)


def _expect(centred, loading, seen, noise):
    """Posterior mean (i, k) and covariance (i, k, k) of each latent, from its seen entries (E-step)."""
    precision = np.einsum("kd,id,ld->ikl", loading, seen, loading, optimize=True) / noise
    precision += np.eye(len(loading))
    covariances = np.linalg.inv(precision)
    return np.einsum("ikl,ld,id->ik", covariances, loading, centred, optimize=True) / noise, covariances
