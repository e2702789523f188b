"""One pass of the network over a zoomed picture, and what it says."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.perception.canonical_view import CanonicalView
from grasptransfer.perception.networks import LATENT_SIZE, Prediction
from grasptransfer.perception.picture_evidence import LatentPrior, Motion
from grasptransfer.perception.signs import PassSigns


@dataclass(frozen=True)
class Look:
    """One pass of the network over the zoomed picture.

    Args:
        camera: of the zoomed picture.
        view: the model as assumed: pose and latent.
        motion: predicted motion of its visible cells from the canonical model.
        latent: what the picture as a whole says of the latent.
        object_probability: (h / 4, w / 4) of the zoomed picture: as given, else as predicted.
        signs: of a wrong input.
        structure: how much the picture shows at all there, as of `signs.structure_of`.
    """

    camera: Camera
    view: CanonicalView
    motion: Motion
    latent: LatentPrior
    object_probability: Float[np.ndarray, "hh hw"]
    signs: PassSigns
    structure: float


def latent_prior(
    prediction: Prediction, assumed: Float[np.ndarray, "k"], overconfidence: float
) -> LatentPrior:
    """What the latent head says; modes beyond its size, and networks without it, keep the prior.

    Args:
        overconfidence: how much larger the stated deviations have to be.
    """
    mean, deviation = np.zeros(len(assumed)), np.ones(len(assumed))
    if prediction.latent is None or prediction.latent_log_scale is None:
        return LatentPrior(mean, deviation)
    size = min(len(assumed), LATENT_SIZE)
    mean[:size] = assumed[:size] + prediction.latent[0, :size]
    log_scale = prediction.latent_log_scale[0, :size]
    deviation[:size] = np.minimum(overconfidence * np.exp(np.clip(log_scale, -4, 0)), 1)
    return LatentPrior(mean, deviation)
