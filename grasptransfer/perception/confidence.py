"""How sure an estimate may be: numbers that belong to a trained network and lie in a YAML file beside it."""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.perception.earlier_pictures import with_latent_covariance

Evidence = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Confidence:
    """What turns a network's own statements into chances that hold.

    Args:
        bias, match, overlap, far: of the logistic model for "is of the category", on `evidence`.
        overconfidence: how much larger the latent's covariance has to be than the fit says.
        latent_overconfidence: how much larger the deviation of the network's latent alone has to be than it
            states. Latent, flow and offsets are read from one picture and err together: alone, the latent is
            less sure than it says.
        accepted_score: least chance of being of the category with which an object is accepted.

    The first five are fitted by `grasptransfer train`; the other two are chosen.
    """

    bias: float = -4.2
    match: float = 0.8
    overlap: float = 6.0
    far: float = -4.0
    overconfidence: float = 4.0
    latent_overconfidence: float = 1.6
    accepted_score: float = 0.2

    def of_the_category(self, evidence: Evidence) -> float:
        """Chance that the object is of the category, in [0, 1]."""
        said = self.bias + np.dot([self.match, self.overlap, self.far], evidence)
        return float(1 / (1 + np.exp(-said)))

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
        return {name: round(float(value), 4) for name, value in asdict(self).items()}


def evidence(match: float, overlap: float, latent: Float[np.ndarray, "k"]) -> Evidence:
    """What speaks for the category.

    Args:
        match: the network's probability.
        overlap: of the reconstruction's silhouette and the predicted mask, intersection over union.
        latent: how far the shape lies from the mean.
    """
    return np.array([np.log((match + 1e-4) / (1 - match + 1e-4)), overlap, np.sqrt(np.mean(latent**2))])
