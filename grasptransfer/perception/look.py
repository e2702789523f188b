"""One pass of the network over a zoomed picture, and what it says."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.perception.canonical_view import CanonicalView
from grasptransfer.perception.network_input import view_from_object
from grasptransfer.perception.networks import FLOW_UNIT, LATENT_SIZE, OFFSET_UNIT, Prediction
from grasptransfer.perception.picture_evidence import LatentPrior, Motion
from grasptransfer.perception.signs import PassSigns


@dataclass(frozen=True)
class Look:
    """One pass of the network over the zoomed picture.

    Args:
        camera: camera of the zoomed picture.
        view: the model as assumed: pose and latent.
        motion: predicted motion of its visible cells from the canonical model.
        latent: what the picture as a whole says of the latent.
        object_probability: (h / 4, w / 4) of the zoomed picture: as given, else as predicted.
        signs: signs of a wrong input.
        structure: how much the picture shows at all there, from `signs.structure_of`.
    """

    camera: Camera
    view: CanonicalView
    motion: Motion
    latent: LatentPrior
    object_probability: Float[np.ndarray, "hh hw"]
    signs: PassSigns
    structure: float


def predicted_motion(
    prediction: Prediction, view: CanonicalView, camera_from_object: Float[np.ndarray, "4 4"]
) -> Motion:
    """Where the points seen in the cells of a view are on the object and in its zoomed picture."""
    offset, offset_scale, flow, flow_scale = (
        part[0][:, view.cell_mask].T.astype(float) for part in prediction[:4]
    )
    return Motion(
        view.cell_places - view.cell_points + offset * OFFSET_UNIT @ view_from_object(camera_from_object),
        np.exp(np.clip(offset_scale[:, 0], -5, 3)) * OFFSET_UNIT,
        view.cell_pixels + flow * FLOW_UNIT,
        np.exp(np.clip(flow_scale[:, 0], -5, 3)) * FLOW_UNIT,
    )


def latent_prior(
    prediction: Prediction, assumed: Float[np.ndarray, "k"], overconfidence: float
) -> LatentPrior:
    """What the latent head says; modes beyond its size, and networks without it, keep the prior.

    Args:
        overconfidence: factor by which the stated deviations are too small.
    """
    mean, deviation = np.zeros(len(assumed)), np.ones(len(assumed))
    if prediction.latent is None or prediction.latent_log_scale is None:
        return LatentPrior(mean, deviation)
    size = min(len(assumed), LATENT_SIZE)
    mean[:size] = assumed[:size] + prediction.latent[0, :size]
    log_scale = prediction.latent_log_scale[0, :size]
    deviation[:size] = np.minimum(overconfidence * np.exp(np.clip(log_scale, -4, 0)), 1)
    return LatentPrior(mean, deviation)
