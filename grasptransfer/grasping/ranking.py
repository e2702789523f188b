"""How likely each grasp is to hold, over the shapes and poses that the picture leaves possible.

For every drawn object (`plausible.py`) the points near each opened gripper give its clearance, what the
pads meet, how flat, and how hard the weight turns the object between them. One logistic model turns the
clearance into the chance of getting there, another the rest into that of holding; the score is the mean of
their product over the draws. One model of everything would let a firm grip make up for a palm in the object.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.grasping.collision import CheckStatus, GraspCheck
from grasptransfer.grasping.experience import Experience
from grasptransfer.grasping.features import features_around
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.plausible import PlausibleObjects
from grasptransfer.grasping.success_model import FEATURES, Features, Ranking, chances
from grasptransfer.grasping.warping import WarpedGrasp


@dataclass(frozen=True)
class Score:
    """How likely a grasp is to hold.

    Args:
        chance: expected success in [0, 1]; 0 for a grasp that failed its check.
        deviation: standard deviation of `chance` under other draws: it is a mean over a few of them.
    """

    chance: float
    deviation: float

    @staticmethod
    def over(each: Float[np.ndarray, "s"]) -> "Score":
        """Of the chances in each draw, in the order in which `draws.paired_draws` gives them.

        The draws are stratified, so their spread about their mean says too much: successive differences leave
        out what the strata explain (von Neumann, Kent, Bellinson and Hart, "The mean square successive
        difference", 1941).
        """
        pairs = each[: len(each) // 2 * 2].reshape(2, -1).mean(axis=0)
        if len(pairs) < 2:
            return Score(float(each.mean()), 0.0)
        variance = np.square(np.diff(pairs)).mean() / 2
        return Score(float(each.mean()), float(np.sqrt(variance / len(pairs))))

    def corrected(self, experience: Experience, grasp: str) -> "Score":
        """By what executed grasps have taught of the annotated grasp with this name."""
        steepness = experience.steepness(self.chance, grasp)
        return Score(experience.score(self.chance, grasp), steepness * self.deviation)


def rank_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
    settings: Ranking | None = None,
) -> tuple[float, ...]:
    """Expected success of each grasp in [0, 1]; 0 for those that failed their check.

    Args:
        grasps: grasps on the instance, object frame.
        checks: their checks.
        plausible: objects that the picture leaves possible; the same ones for all grasps.
    """
    found = score_grasps(grasps, checks, gripper, plausible=plausible, settings=settings)
    return tuple(score.chance for score in found)


def score_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
    settings: Ranking | None = None,
    experience: Experience | None = None,
) -> tuple[Score, ...]:
    """Expected success of each grasp, and how sure it is; other arguments as of `rank_grasps`.

    Args:
        experience: corrects the chances by what executed grasps have taught; None leaves them.
    """
    weights = (settings or Ranking.fitted()).weights
    features = grasp_features(grasps, checks, gripper, plausible=plausible)
    experience = experience or Experience()
    return tuple(
        Score.over(chances(each, weights)).corrected(experience, grasp.name)
        if check.usable
        else Score(0.0, 0.0)
        for grasp, each, check in zip(grasps, features, checks, strict=True)
    )


def grasp_features(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    plausible: PlausibleObjects,
) -> list[Features]:
    """What the ranking judges by, for each usable grasp and draw; NaN where a pad meets nothing.

    Unusable grasps get no rows. Arguments as of `rank_grasps`.
    """
    return [
        features_around(grasp, check.opening, gripper, plausible, room=check.room)
        if check.usable
        else np.zeros((0, len(FEATURES)))
        for grasp, check in zip(grasps, checks, strict=True)
    ]


def mark_unlikely(
    checks: Sequence[GraspCheck],
    scores: Sequence[float],
    *,
    trust: float = 1.0,
    least_chance: float = Ranking.least_chance,
) -> list[GraspCheck]:
    """The checks, with grasps that are reached but unlikely to hold made unusable, and the reason why.

    Args:
        trust: chance that the picture shows the category, which the scores contain.
    """
    return [
        replace(check, status=CheckStatus.UNLIKELY_TO_HOLD, reason=_why_unlikely(score, trust))
        if check.usable and score < least_chance
        else check
        for check, score in zip(checks, scores, strict=True)
    ]


def _why_unlikely(score: float, trust: float) -> str:
    if trust < 0.5:
        return f"expected success {score:.0%}: the picture hardly shows this category at the given pose"
    return f"expected success {score:.0%} over the shapes and poses that the picture leaves possible"
