"""How far points are displaced, as a linear function of the latent, and how they move with pose and latent.

A point Z of the canonical model lies at p = R (Z + mean + basis x) + t, where x is the latent and (R, t) the
pose. A turn of the object about its origin, a shift and a change of the latent, in this order and along the
axes of the frame that p is in, move it by dp = turn x R (Z + mean + basis x) + shift + R basis dx.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class DisplacementModel:
    """The displacement of m points as a linear function of the latent.

    Args:
        mean: (m, 3) displacement of the mean shape, object axes [m].
        basis: (m, 3, k) what one standard deviation of each mode adds to it, object axes [m].
    """

    mean: Float[np.ndarray, "m 3"]
    basis: Float[np.ndarray, "m 3 k"]

    @property
    def n_modes(self) -> int:
        """k, the length of the latent."""
        return self.basis.shape[2]

    def __len__(self) -> int:
        return len(self.mean)

    def at(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "m 3"]:
        """The displacements of the shape with this latent [m]."""
        # One product of a matrix and a vector: a stack of small ones takes four times as long.
        moved = self.basis.reshape(-1, self.n_modes) @ latent
        return self.mean + moved.reshape(self.mean.shape)

    def displaced(
        self, points: Float[np.ndarray, "m 3"], latent: Float[np.ndarray, "k"]
    ) -> Float[np.ndarray, "m 3"]:
        """The points of the shape with this latent, object frame [m].

        Args:
            points: (m, 3) the points that this model displaces, canonical frame [m].
        """
        return points + self.at(latent)

    def take(self, rows: Any) -> "DisplacementModel":
        """The model of the chosen points: an index array, a mask or a slice."""
        return DisplacementModel(self.mean[rows], self.basis[rows])


def motion_along(
    directions: Float[np.ndarray, "p 3"],
    turned: Float[np.ndarray, "p 3"],
    basis: Float[np.ndarray, "p 3 k"],
    rotation: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "p s"]:
    """Derivative by turn, shift and latent of how far points go along given directions.

    Args:
        directions: (p, 3) in the frame that the pose leads to.
        turned: (p, 3) the points from the object's origin, along the axes of that frame [m].
        basis: (p, 3, k) how the latent moves them, object axes [m].
        rotation: (3, 3) of the pose, from object axes to those of that frame.
    """
    motion = np.empty((len(directions), 6 + basis.shape[2]))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # the cross product
        motion[:, a] = turned[:, b] * directions[:, c] - turned[:, c] * directions[:, b]
    motion[:, 3:6] = directions
    np.einsum("pi,pik->pk", directions @ rotation, basis, out=motion[:, 6:])
    return motion
