"""The chance that a grasp holds, from what the ranking measures around it: two logistic models.

One model turns the clearance into the chance of getting there, the other the rest into that of holding. One
model of everything would let a firm grip make up for a palm in the object.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from grasptransfer.category import objects_folder
from grasptransfer.errors import GraspFileError
from grasptransfer.fitted import Fit, read_fits, write_fits

FEATURES = ("clearance", "flatness", "coverage", "moment", "load")
WEIGHTS = ("entry", "clearance", "bias", "flatness", "coverage", "moment")
BLOCKS = {"ranking": WEIGHTS}

# How sharply the chance falls where the load nears the most that friction can bear. No weight to fit: with an
# exact mass, friction and force Coulomb's law knows the answer, and what is not exact is drawn.
BEARING = 10.0

Features = Float[np.ndarray, "s 5"]
Weights = Float[np.ndarray, "6"]


@dataclass(frozen=True)
class Ranking:
    """The logistic models of a grasp on one drawn object, and what counts as unlikely.

    Args:
        entry, clearance: weights of getting there, fitted to simulated grasps by
            `grasptransfer bench calibration`.
        bias, flatness, coverage, moment: weights of holding, fitted likewise.
        least_chance: a grasp that the gripper reaches is unusable below this score.

    The features: clearance in mm (between -12 and 3), flatness as a cosine, coverage as a share of a pad's
    points, moment in kg cm: mass times how far its centre lies from where the pads would hold it best, scaled
    from their friction and force to those of the simulation protocols. What lies beside the closing line has
    most of it, what hangs straight below the pads little. The load is what the weight, and a shake of as much
    again, take of the most that friction can bear; it needs no weight: beyond 1 nothing holds.
    """

    entry: float
    clearance: float
    bias: float
    flatness: float
    coverage: float
    moment: float
    least_chance: float = 0.3

    @staticmethod
    @cache
    def fitted() -> "Ranking":
        """The one that is shipped: `objects/models/ranking.yaml`.

        Raises:
            GraspFileError: the file is missing, or something in it is wrong.
        """
        return Ranking(**read_fits(ranking_path(), BLOCKS, error=GraspFileError)["ranking"].values)

    @property
    def weights(self) -> Weights:
        """`WEIGHTS`, in their order."""
        return np.array([getattr(self, name) for name in WEIGHTS])


def ranking_path() -> Path:
    """Where the weights of the ranking lie, with the command that fitted them and the date."""
    return objects_folder() / "models" / "ranking.yaml"


def write_ranking(weights: Weights, *, path: Path | None = None) -> None:
    """Write fitted weights for all later processes, with the command of this process and today's date.

    Args:
        weights: `WEIGHTS`, in their order.
        path: None: `ranking_path`.
    """
    fit = Fit.today(dict(zip(WEIGHTS, weights.tolist(), strict=True)))
    write_fits(path or ranking_path(), {"ranking": fit})


def expected_success(
    features: Float[np.ndarray, "*g s 5"], weights: Weights
) -> Float[np.ndarray, "*g"] | np.floating:
    """Mean chance of getting there and holding, over the draws; where a pad meets nothing there is none."""
    return chances(features, weights).mean(axis=-1)


def chances(features: Float[np.ndarray, "*g s 5"], weights: Weights) -> Float[np.ndarray, "*g s"]:
    """Chance of getting there and holding, in each draw."""
    entry, clearance, bias, *others = weights
    enters = expit(entry + clearance * features[..., 0])
    holds = expit(bias + features[..., 1:4] @ np.array(others))
    bears = expit(BEARING * (1 - features[..., 4]))
    return np.nan_to_num(enters * holds * bears, nan=0.0)
