"""What principal components compare of two fields: what they do, how they bend, or how they are written.

Two fields may look alike and still differ in W, along directions that G hardly shows. So they are
compared in G W (displacement of the control points, the default), in W's norm under G (how much the
field bends), or in W as the paper does.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from grasptransfer.registration.kernels import LowRankKernel, pivoted_cholesky

Metric = Literal["GW", "G", "W"]
METRICS = get_args(Metric)


@dataclass(frozen=True, eq=False)
class FieldMetric:
    """Turns weights into features whose plain distance is the metric, and back.

    Args:
        kind: "GW", "G" or "W".
        points: (n, 3) control points, normalised.
        beta: kernel width, normalised.
    """

    kind: Metric
    points: Float[np.ndarray, "n 3"]
    beta: float

    def features(self, weights: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "d 3"]:
        """Weights as the metric sees them."""
        if self.kind == "W":
            return weights
        coefficients = self._low_rank.factor.T @ weights
        return coefficients if self.kind == "G" else self._low_rank.factor @ coefficients

    def weights_of(self, features: Float[np.ndarray, "d"], noise: float) -> Float[np.ndarray, "n 3"]:
        """The shortest weights that the metric sees as these features, but for their noise.

        Args:
            features: (d,) one coordinate after the other for each point.
            noise: variance of each feature; 0 for features of a smooth field.
        """
        features = features.reshape(-1, 3)
        if self.kind == "W":
            return features
        if self.kind == "GW":  # ridge: only very large weights could follow noise through G
            factor = self._low_rank.factor
            normal = factor.T @ factor + max(noise, 1e-14) * np.eye(factor.shape[1])
            features = np.linalg.solve(normal, factor.T @ features)
        return self._low_rank.shortest_weights(features)

    @cached_property
    def _low_rank(self) -> LowRankKernel:
        return pivoted_cholesky(self.points, self.beta, tolerance=1e-10)
