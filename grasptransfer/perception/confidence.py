"""How sure an estimate may be: numbers that belong to a trained network and lie in a YAML file beside it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from grasptransfer.perception.earlier_pictures import with_latent_covariance
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.signs import OF_PASS, SIGNS, PassSigns, Signs

WRONG = (
    EstimateStatus.NOTHING_SEEN,
    EstimateStatus.OUT_OF_CATEGORY,
    EstimateStatus.POSE_TURNED,
    EstimateStatus.IMPOSSIBLE_SIZE,
    EstimateStatus.BOX_MISPLACED,
)
TERMS = ("bias", *SIGNS)
VERDICTS = tuple(f"{status.value}.{term}" for status in WRONG for term in TERMS)

PASS = tuple(f"pass.{sign}" for sign in OF_PASS)
POSE = tuple(f"pose.{sign}" for sign in SIGNS)

VerdictWeights = Float[np.ndarray, "5 24"]
PassWeights = Float[np.ndarray, "8"]
PoseWeights = Float[np.ndarray, "23"]


def _starting_values() -> VerdictWeights:
    """Of a network that nothing was fitted to yet: a match, an outline that fits, a shape near the mean."""
    weights = np.zeros((len(WRONG), len(TERMS)))
    weights[:, 0] = -9.0
    stranger = {"bias": 4.2, "last_match": -0.8, "overlap": -6.0, "far": 4.0}
    weights[WRONG.index(EstimateStatus.OUT_OF_CATEGORY)] = [stranger.get(term, 0.0) for term in TERMS]
    return weights


def _starting_pass() -> PassWeights:
    return np.array([1.0 if sign == "match" else 0.0 for sign in OF_PASS])


def _starting_pose() -> PoseWeights:
    return np.array([1.0 if sign == "last_match" else 0.0 for sign in SIGNS])


@dataclass(frozen=True, eq=False)
class Confidence:
    """What turns a network's own statements into chances that hold.

    Args:
        verdicts: of a multinomial logistic model: for each way of `WRONG` in which an input may be wrong the
            logarithm of its odds against a right one, linear in `SIGNS`; the bias comes first.
        of_pass, of_pose: of two logistic models: logarithm of the odds of one pose against another for one
            picture, linear in the signs of the first pass alone, and in all signs.
        overconfidence: how much larger the latent's covariance has to be than the fit says.
        latent_overconfidence: how much larger the deviation of the network's latent alone has to be than it
            states. Latent, flow and offsets are read from one picture and err together: alone, the latent is
            less sure than it says.
        accepted_score: least chance of a right input with which an estimate is `OK`.

    Those up to `overconfidence` are fitted by `grasptransfer train`; the others are chosen.
    """

    verdicts: VerdictWeights = field(default_factory=_starting_values)
    of_pass: PassWeights = field(default_factory=_starting_pass)
    of_pose: PoseWeights = field(default_factory=_starting_pose)
    overconfidence: float = 4.0
    latent_overconfidence: float = 1.6
    accepted_score: float = 0.2

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Confidence) and self.as_data() == other.as_data()

    __hash__ = None  # pyright: ignore[reportAssignmentType]: numbers in arrays

    @staticmethod
    def of_data(values: Mapping[str, float]) -> "Confidence":
        """The numbers of `as_data`; without those of the verdicts, the starting values stand for them."""
        others = {name: values[name] for name in OTHERS if name in values}
        if VERDICTS[0] not in values:
            return Confidence(**others)  # pyright: ignore[reportArgumentType]
        table = np.array([values[name] for name in VERDICTS]).reshape(len(WRONG), len(TERMS))
        of_pass, of_pose = (np.array([values[name] for name in names]) for names in (PASS, POSE))
        return Confidence(table, of_pass, of_pose, **others)

    def chances(self, signs: Signs) -> Float[np.ndarray, "6"]:
        """Chance of a right input, then of each of `WRONG`, were right and wrong inputs alike likely."""
        odds = np.concatenate([[0.0], self.verdicts @ np.concatenate([[1.0], signs])])
        shares = np.exp(odds - odds.max())
        return shares / shares.sum()

    def preference(self, signs: PassSigns | Signs) -> float:
        """How well a pose explains its picture: of several poses for one picture, the highest is preferred.

        Differences are logarithms of odds.

        Args:
            signs: signs of the first pass alone, or all signs.
        """
        return float((self.of_pass if len(signs) == len(OF_PASS) else self.of_pose) @ signs)

    def judge(self, signs: Signs, *, settled: bool) -> tuple[EstimateStatus, float]:
        """Status of an estimate, and the chance that its input is right.

        Args:
            settled: whether the fit converged.
        """
        chances = self.chances(signs)
        if chances[0] < self.accepted_score:
            return WRONG[int(np.argmax(chances[1:]))], float(chances[0])
        return EstimateStatus.OK if settled else EstimateStatus.NOT_CONVERGED, float(chances[0])

    def widened(self, covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
        """The latent's covariance with which stated intervals hold, no wider than the shape space's own."""
        values, vectors = np.linalg.eigh(covariance)
        return (vectors * np.minimum(values * self.overconfidence, 1.0)) @ vectors.T

    def widened_with_pose(self, covariance: Float[np.ndarray, "s s"]) -> Float[np.ndarray, "s s"]:
        """The joint covariance over turn, shift and latent with the latent's part widened.

        How the pose goes with the latent (distance with size) stays, and so does its own uncertainty.
        """
        return with_latent_covariance(covariance, self.widened(covariance[6:, 6:]))

    def as_data(self) -> dict[str, float]:
        """Every number by its name, as files hold it."""
        numbers = dict(zip(VERDICTS, self.verdicts.ravel(), strict=True))
        numbers |= dict(zip(PASS + POSE, [*self.of_pass, *self.of_pose], strict=True))
        numbers |= {name: getattr(self, name) for name in OTHERS}
        return {name: round(float(value), 4) for name, value in numbers.items()}


OTHERS = ("overconfidence", "latent_overconfidence", "accepted_score")
