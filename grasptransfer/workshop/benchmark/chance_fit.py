"""Fits of the ranking to executed grasps: its weights, and what experience adds to its chances.

    p     = trust * mean over draws of P(reached) P(held)           weights of `success_model`
    score = sigmoid(shift + slope logit(p) + b[grasp])              `grasping/experience.py`

Both maximise the likelihood of what held. Every object counts alike, however many grasps of it were executed;
a photographed drill of which there are thirty pictures is one object. Judged are objects left out of the fit:
each score comes from a fit that has seen no grasp of the scored object.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from grasptransfer.grasping.experience import SURE
from grasptransfer.grasping.success_model import Ranking, Weights, expected_success
from grasptransfer.workshop.benchmark.executed_grasps import Executed
from grasptransfer.workshop.benchmark.reliability import Chance

# Keeps weights for which few grasps are evidence near the present ones.
RIDGE = 0.01
# How strongly experience with a grasp is held near none. On 279 pictures of 60 objects left out of the fit,
# 0.01, 0.001, 0.0003 and 0.0001 give 70, 75, 77 and 78 % of best-ranked grasps that hold, and a log loss of
# 0.552, 0.537, 0.532 and 0.534.
POOLING = 0.0003
FOLDS = 8  # parts into which the objects are divided, each left out once


@dataclass(frozen=True)
class FittedScores:
    """All that turns features into a score.

    Args:
        weights: of the ranking.
        shift, slope, of_grasps: as of `Experience`; the grasps by `category/name`.
    """

    weights: Weights
    shift: float
    slope: float
    of_grasps: dict[str, float]

    def scores(self, executed: Sequence[Executed]) -> Float[np.ndarray, "g"]:
        """The score of each grasp."""
        known = np.array([self.of_grasps.get(one.grasp, 0.0) for one in executed])
        odds = _log_odds(likely(executed, self.weights))
        return expit(self.shift + self.slope * odds + known) * np.array([one.trust for one in executed])


def likely(executed: Sequence[Executed], weights: Weights) -> Float[np.ndarray, "g"]:
    """The ranking's own chance of each grasp, before experience and trust."""
    return np.asarray(expected_success(np.stack([one.features for one in executed]), weights))


def fit_chances(executed: Sequence[Executed]) -> FittedScores:
    """Weights first, then experience on their chances."""
    weights = fit_weights(executed)
    names = sorted({one.grasp for one in executed})
    shift, slope, *of_grasps = _fit_experience(executed, likely(executed, weights), names)
    return FittedScores(weights, shift, slope, dict(zip(names, of_grasps, strict=True)))


def fit_weights(executed: Sequence[Executed]) -> Weights:
    """The ranking's weights under which the observed outcomes are most likely."""
    from scipy.optimize import minimize

    start = Ranking.fitted().weights
    held, count = np.array([one.held for one in executed]), weight_of_each(executed)
    features, trust = np.stack([one.features for one in executed]), np.array([one.trust for one in executed])

    def loss(weights):
        chance = trust * np.asarray(expected_success(features, weights))
        return _loss(chance, held, count) + RIDGE * np.square((weights - start) / np.abs(start)).mean()

    return minimize(loss, start, method="L-BFGS-B", options={"maxiter": 100}).x


def left_out_scores(
    executed: Sequence[Executed], *, folds: int = FOLDS, seed: int = 0
) -> Float[np.ndarray, "g"]:
    """The score of each grasp by a fit without its object."""
    objects = sorted({one.object for one in executed})
    shuffled = np.random.default_rng(seed).permutation(objects)
    fold = {str(name): number % folds for number, name in enumerate(shuffled)}
    scores = np.zeros(len(executed))
    for number in range(folds):
        out = np.array([fold[one.object] == number for one in executed])
        if out.any() and not out.all():
            fitted = fit_chances([one for one, away in zip(executed, out, strict=True) if not away])
            scores[out] = fitted.scores([one for one, away in zip(executed, out, strict=True) if away])
    return scores


def log_loss(executed: Sequence[Executed], scores: Float[np.ndarray, "g"]) -> float:
    """Mean negative log likelihood of what held, every object counting alike."""
    held = np.array([one.held for one in executed])
    return _loss(scores, held, weight_of_each(executed))


def weight_of_each(executed: Sequence[Executed]) -> Float[np.ndarray, "g"]:
    """Weights of grasps whose sum is the same for every object, and one in all."""
    numbers, counts = np.unique([one.object for one in executed], return_inverse=True, return_counts=True)[1:]
    return 1 / (counts[numbers] * len(counts))


def best_of_pictures(executed: Sequence[Executed], scores: Float[np.ndarray, "g"]) -> list[Chance | None]:
    """The grasp with the highest score of every picture."""
    best: dict[tuple[str, str], Chance] = {}
    for one, score in zip(executed, scores, strict=True):
        key = (one.object, one.picture)
        if key not in best or score > best[key].stated:
            best[key] = Chance(float(score), one.held)
    return list(best.values())


def _fit_experience(
    executed: Sequence[Executed], chances: Float[np.ndarray, "g"], names: list[str]
) -> Float[np.ndarray, "n"]:
    """Shift, slope, and what is added to the log odds of each of the named grasps."""
    from scipy.optimize import minimize

    held, count, odds = (
        np.array([one.held for one in executed]),
        weight_of_each(executed),
        _log_odds(chances),
    )
    trust = np.array([one.trust for one in executed])
    which = np.array([names.index(one.grasp) for one in executed])

    def loss(values):
        chance = trust * expit(values[0] + values[1] * odds + values[2:][which])
        return (
            _loss(chance, held, count) + POOLING * np.square(values[2:]).sum() + RIDGE * (values[1] - 1) ** 2
        )

    start = np.concatenate([[0.0, 1.0], np.zeros(len(names))])
    return minimize(loss, start, method="L-BFGS-B", options={"maxiter": 200}).x


def _loss(chance: np.ndarray, held: np.ndarray, count: np.ndarray) -> float:
    chance = np.clip(chance, SURE, 1 - SURE)
    return float(-count @ np.where(held, np.log(chance), np.log(1 - chance)))


def _log_odds(chance: np.ndarray) -> np.ndarray:
    bounded = np.clip(chance, SURE, 1 - SURE)
    return np.log(bounded / (1 - bounded))
