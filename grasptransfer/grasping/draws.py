"""Draws from a Gaussian that change little where the Gaussian changes little, and that stand for it well.

Scores are means over draws, so the draws' own error is the scores'. Three things keep it small: each draw has
its opposite beside it, each coordinate is stratified (a Latin hypercube: McKay, Beckman and Conover, 1979),
and so is the one direction that moves the object most; of a picture, that is nearly always size and distance
together. The root of the covariance is the symmetric one: unlike a factor of eigenvectors, it is a continuous
function of the covariance, so that noise in a picture moves the draws no more than the posterior.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri


def paired_draws(
    covariance: Float[np.ndarray, "d d"],
    effect: Float[np.ndarray, "m d"],
    count: int,
    *,
    others: int = 0,
    seed: int = 0,
) -> tuple[Float[np.ndarray, "s d"], Float[np.ndarray, "s o"]]:
    """Draw pairs on either side of zero; the second half are the opposites of the first.

    They come in the order of the strongest direction, so that every other pair is stratified, too.

    Args:
        covariance: covariance of the Gaussian; it may be singular.
        effect: what each coordinate moves, in any unit that is the same for all rows.
        count: number of draws; an odd one is rounded up.
        others: independent standard normal variables that are drawn along with it.
        seed: seed of the order in which strata are combined.

    Returns:
        The draws, and those of the other variables.
    """
    half, size = (count + 1) // 2, len(covariance)
    strata = ndtri((np.arange(half) + 0.5) / half)
    rng = np.random.default_rng(seed)
    normal = np.stack([rng.permutation(strata) for _ in range(size + others)], axis=1)
    root = _symmetric_root(covariance)
    along = _strongest(effect @ root)
    normal[:, :size] += np.outer(strata - normal[:, :size] @ along, along)
    both = np.concatenate([normal, -normal])
    return both[:, :size] @ root, both[:, size:]


def _symmetric_root(covariance: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d d"]:
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T


def _strongest(effect: Float[np.ndarray, "m d"]) -> Float[np.ndarray, "d"]:
    """About the unit direction of the largest effect.

    A few steps of the power method from a fixed start: unlike an eigenvector, its end moves little where two
    directions are almost alike, and has no second sign.
    """
    square, direction = effect.T @ effect, np.ones(effect.shape[1])
    for _ in range(4):
        direction = square @ direction
        direction /= np.linalg.norm(direction)
    return direction
