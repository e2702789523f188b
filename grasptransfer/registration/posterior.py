"""What is known of a latent once part of an instance was seen."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import SettingsError
from grasptransfer.registration.displacement_model import DisplacementModel


@dataclass(frozen=True, eq=False)
class LatentPosterior:
    """What observed displacements say of the latent.

    Args:
        mean: (k,) most likely latent.
        covariance: (k, k) how unsure it is.
        residual_rms: root mean square of the displacements that the space cannot explain [m].
    """

    mean: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "k k"]
    residual_rms: float

    @classmethod
    def of(
        cls,
        model: DisplacementModel,
        displacements: Float[np.ndarray, "m 3"],
        noise_std: Float[np.ndarray, "m"] | float,
    ) -> "LatentPosterior":
        """The posterior of x ~ N(0, I), given displacements = mean + basis x + noise.

        Args:
            model: displacement of the m points, from `ShapeSpace.displacement_model`.
            displacements: (m, 3) what was seen [m].
            noise_std: standard deviation of its errors, per coordinate; one for all or (m,) [m].

        Raises:
            SettingsError: a noise that is not finite and above 0.
        """
        noise = np.broadcast_to(np.asarray(noise_std, dtype=float), (len(model),))
        if not (np.isfinite(noise).all() and (noise > 0).all()):
            raise SettingsError("must be finite and above 0", key="noise_std")
        basis = model.basis
        weighted = (basis / noise[:, None, None]).reshape(-1, basis.shape[2])
        offset = ((displacements - model.mean) / noise[:, None]).ravel()
        covariance = np.linalg.inv(np.eye(basis.shape[2]) + weighted.T @ weighted)
        latent = covariance @ (weighted.T @ offset)
        residual = displacements - model.mean - basis @ latent
        rms = float(np.sqrt(np.square(residual).sum(1).mean())) if len(residual) else 0.0
        return cls(latent, (covariance + covariance.T) / 2, rms)

    def sample(self, rng: np.random.Generator, count: int) -> Float[np.ndarray, "s k"]:
        """`count` plausible latents, to see how unsure the hidden side is."""
        return rng.multivariate_normal(self.mean, self.covariance, size=count)


@dataclass(frozen=True)
class SpaceScore:
    """How well a field belongs to the category.

    Args:
        mahalanobis: RMS of the latent's entries; about 1 for members of the category.
        residual_rms: displacement of the control points that the space cannot express [m].
    """

    mahalanobis: float
    residual_rms: float
