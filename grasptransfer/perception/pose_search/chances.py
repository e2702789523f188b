"""How likely each proposed pose is, from the traits that speak for it: weights fitted on random shapes.

Traits turn into a score by one weight each; the softmax of the scores, with "none of them" as one more
alternative, is the chance of each. What `bench pose --random N --write` fits lies in `models/poses.yaml`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from grasptransfer.category import objects_folder
from grasptransfer.errors import WeightsError
from grasptransfer.fitted import Fit, read_fits, write_fits
from grasptransfer.perception.pose_search.traits import POSE_TRAITS, VIEW_TRAITS

FILE = "poses.yaml"
NONE = "none"
DEVIATION = ("along_ray", "across_ray", "turn")
RIDGE = 0.02  # of standardised weights: some dozens of pictures fit a dozen weights


@dataclass(frozen=True)
class Weights:
    """Of one set of traits.

    Args:
        by_trait: weight of each.
        none: score of "none of them"; None where one of them is right for certain.
    """

    by_trait: Float[np.ndarray, "t"]
    none: float | None = None

    def chances(self, traits: Float[np.ndarray, "c t"]) -> Float[np.ndarray, "c"]:
        """Of each alternative; they sum to 1, or to less by the chance of none."""
        scores = np.append(traits @ self.by_trait, -np.inf if self.none is None else self.none)
        shares = np.exp(scores - scores.max())
        return (shares / shares.sum())[:-1]


@dataclass(frozen=True)
class FittedChances:
    """All that is fitted of the search.

    Args:
        views: weights of `VIEW_TRAITS`.
        poses: weights of `POSE_TRAITS`.
        along_ray, across_ray: standard deviations of a right proposal, shares of the distance.
        turn: deviation about each axis [deg].
    """

    views: Weights
    poses: Weights
    along_ray: float
    across_ray: float
    turn: float

    @staticmethod
    @lru_cache(maxsize=2)
    def read(path: Path | None = None) -> "FittedChances":
        """Of a file; None takes the shipped one.

        Raises:
            WeightsError: missing or damaged.
        """
        names = {"views": VIEW_TRAITS, "poses": (*POSE_TRAITS, NONE), "deviation": DEVIATION}
        fits = read_fits(path or chances_path(), names, error=WeightsError)
        views, poses = fits["views"].values, fits["poses"].values
        return FittedChances(
            Weights(np.array([views[name] for name in VIEW_TRAITS])),
            Weights(np.array([poses[name] for name in POSE_TRAITS]), poses[NONE]),
            **fits["deviation"].values,
        )


def chances_path() -> Path:
    """Where the fitted numbers lie."""
    return objects_folder() / "models" / FILE


def write_chances(path: Path, views: Weights, poses: Weights, deviation: Mapping[str, float]) -> None:
    """Write fitted numbers with the command that fitted them and the date."""
    assert poses.none is not None
    values = {
        "views": dict(zip(VIEW_TRAITS, views.by_trait, strict=True)),
        "poses": {**dict(zip(POSE_TRAITS, poses.by_trait, strict=True)), NONE: poses.none},
        "deviation": {name: deviation[name] for name in DEVIATION},
    }
    write_fits(path, {name: Fit.today(one) for name, one in values.items()})
    FittedChances.read.cache_clear()


def fit_weights_of_traits(
    traits: Sequence[Float[np.ndarray, "c t"]], right: Sequence[Bool[np.ndarray, "c"]], *, none: bool
) -> Weights:
    """The weights under which the right alternatives of all pictures are likeliest.

    Args:
        traits: traits of the alternatives of each picture.
        right: which of them are right; several may be, or none.
        none: whether "none of them" is an alternative; without, pictures without a right one say nothing.
    """
    pairs = [(one, good) for one, good in zip(traits, right, strict=True) if none or good.any()]
    every = np.concatenate([one for one, _ in pairs])
    middle, spread = every.mean(0), every.std(0) + 1e-9

    def loss(weights: Float[np.ndarray, "t1"]) -> float:
        total = 0.0
        for one, good in pairs:
            scores = (one - middle) / spread @ weights[:-1]
            scores = np.append(scores, weights[-1] if none else -np.inf)
            wanted = np.append(good, none and not good.any())
            total += np.logaddexp.reduce(scores) - np.logaddexp.reduce(scores[wanted])
        return total / len(pairs) + RIDGE * float(weights[:-1] @ weights[:-1])

    found = minimize(loss, np.zeros(every.shape[1] + 1)).x
    by_trait = found[:-1] / spread
    return Weights(by_trait, float(found[-1] + middle @ by_trait) if none else None)
