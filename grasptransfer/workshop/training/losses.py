"""Training losses on a network's `Prediction`."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from grasptransfer.errors import SettingsError
from grasptransfer.perception.networks import FLOW_UNIT, OFFSET_UNIT, Prediction

LOSSES = ("likelihood", "paper")
MASK_WEIGHT = 5.0  # The mask matters for the shape: knowing the true outline would halve the shape's error.
# Of the errors, that of the offsets, on which the shape rests most, stays the largest term.
FLOW_WEIGHT, SHAPE_WEIGHT = 0.5, 0.5
# A likelihood has no lower bound: it may shape the stated scales, and not outweigh the errors.
LIKELIHOOD_WEIGHT, LATENT_WEIGHT = 0.2, 0.3
MATCH_WEIGHT = 0.3  # The task is soon solved: 99 % of the held-out objects are classified correctly.


def training_loss(
    prediction: Prediction, targets: dict[str, Tensor], loss: str
) -> dict[str, Float[Tensor, ""]]:
    """The loss and its terms; `total` is minimised, errors are in millimetres and zoomed pixels.

    Args:
        loss: "likelihood": Laplace likelihood of offsets and flow, each with its own predicted scale,
            Gaussian likelihood of the latent, and cross-entropy of mask and match; heads that a network
            lacks are left out. "paper": squared offset error times 1000 (section IV-C), in metres.
    """
    valid = targets["valid"]
    count = valid.sum().clamp(min=1)
    offset_error = _length(prediction.offset - targets["offset"])
    flow_error = _length(prediction.flow - targets["flow"])
    match = targets["match"]  # An object of another category has neither a shape nor a mask to learn.
    mask = functional.binary_cross_entropy_with_logits(
        prediction.mask_logit, targets["mask"], match[:, None, None, None].expand_as(targets["mask"])
    )
    terms = {
        "offset_mm": (offset_error * valid).sum() / count * OFFSET_UNIT * 1000,
        "flow_px": (flow_error * valid).sum() / count * FLOW_UNIT,
        "mask": mask,
        "iou": _iou(prediction.mask_logit, targets["mask"], match),
    }
    heads: list[Tensor] = []
    if prediction.latent is not None and prediction.latent_log_scale is not None:
        terms["shape_mm"], latent = _latent_terms(prediction.latent, prediction.latent_log_scale, targets)
        heads.append(SHAPE_WEIGHT * terms["shape_mm"] / (1000 * OFFSET_UNIT) + LATENT_WEIGHT * latent)
    if prediction.match_logit is not None:
        logit = prediction.match_logit.float()
        heads.append(MATCH_WEIGHT * functional.binary_cross_entropy_with_logits(logit, match))
        terms["match"] = ((logit > 0) == (match > 0.5)).float().mean()
    if loss == "paper":
        squared = ((offset_error * OFFSET_UNIT) ** 2 * valid).sum() / count
        return terms | {"total": squared * 1000}
    if loss != "likelihood":
        raise SettingsError("unknown loss", key="loss", value=loss, choices=LOSSES)
    offset = _laplace(offset_error, prediction.offset_log_scale, 3)
    flow = _laplace(flow_error, prediction.flow_log_scale, 2)
    likelihood = ((offset + flow) * valid).sum() / count
    # The plain errors keep pulling where a large predicted scale has made the likelihood flat.
    robust = ((offset_error + FLOW_WEIGHT * flow_error) * valid).sum() / count
    return terms | {"total": LIKELIHOOD_WEIGHT * likelihood + robust + MASK_WEIGHT * mask + sum(heads)}


def _latent_terms(latent: Tensor, log_scale: Tensor, targets: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Mean displacement error of the predicted latent [mm], and its negative log likelihood a mode."""
    error = latent.float() - targets["latent"]
    size, match = targets["mode_size"], targets["match"]
    count = match.sum().clamp(min=1)
    moved = ((error * size).square().sum(1) + 1e-6).sqrt()
    log_scale = log_scale.float().clamp(-4, 1)
    known = (size > 0) * match[:, None]
    likelihood = 0.5 * (error * torch.exp(-log_scale)).square() + log_scale
    return (moved * match).sum() / count * 1000 * OFFSET_UNIT, (likelihood * known).sum() / known.sum().clamp(
        min=1
    )


def _laplace(error: Tensor, log_scale: Tensor, dimensions: int) -> Tensor:
    """Negative log likelihood of an isotropic Laplace error of this length."""
    log_scale = log_scale.clamp(-5, 3)
    return error * torch.exp(-log_scale) + dimensions * log_scale


def _length(error: Tensor) -> Tensor:
    # The small constant keeps the gradient finite at zero error.
    return (error.float().square().sum(1, keepdim=True) + 1e-6).sqrt()


def _iou(logit: Tensor, mask: Tensor, match: Tensor) -> Tensor:
    predicted, true = logit > 0, mask > 0.5
    both = (predicted & true).sum((1, 2, 3)).float()
    ratio = both / (predicted | true).sum((1, 2, 3)).clamp(min=1)
    return (ratio * match).sum() / match.sum().clamp(min=1)
