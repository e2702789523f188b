"""Networks that see the observed and the canonical picture and predict, per canonical pixel, how it moves.

Every network maps `(b, 8, 192, 256)` (observed RGB and box mask, coordinates and mask of the model as
assumed so far) and the number of each sample's category to a `Prediction`.
"""

from typing import NamedTuple, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from grasptransfer.errors import SettingsError

STRIDE = 8  # input pixels per cell of offsets and flow
CELL_PIXEL = 2  # which row and column of its pixels a cell stands for
OFFSET_UNIT = 0.01  # m: the networks predict offsets in centimetres, numbers near one
FLOW_UNIT = 10.0  # px of the zoomed picture
LATENT_SIZE = 40  # modes a network can speak of; a shape space with more keeps the rest at its prior


class Prediction(NamedTuple):
    """Network output; cell (i, j) belongs to zoomed pixel (u, v) = (8 j + 2, 8 i + 2).

    Args:
        offset: how much farther the assumed model's point seen in the cell is displaced, view axes
            (`network_input.view_from_object`) [OFFSET_UNIT].
        offset_log_scale: logarithm of its Laplace scale [OFFSET_UNIT].
        flow: from the cell's pixel to where the point is observed [FLOW_UNIT].
        flow_log_scale: logarithm of its Laplace scale [FLOW_UNIT].
        mask_logit: of the observed object, at a quarter of the input's resolution.
        latent: what the assumed latent lacks, None from a network without this head.
        latent_log_scale: logarithm of the standard deviation of its error.
        match_logit: that the observed object is of the category.
        flow_spread: how far the members of an ensemble differ in the flow: standard deviation [FLOW_UNIT].
        mask_spread: and in the mask's probability.
    """

    offset: Float[Tensor, "b 3 24 32"]
    offset_log_scale: Float[Tensor, "b 1 24 32"]
    flow: Float[Tensor, "b 2 24 32"]
    flow_log_scale: Float[Tensor, "b 1 24 32"]
    mask_logit: Float[Tensor, "b 1 48 64"]
    latent: Float[Tensor, "b 40"] | None = None
    latent_log_scale: Float[Tensor, "b 40"] | None = None
    match_logit: Float[Tensor, "b"] | None = None
    flow_spread: Float[Tensor, "b 24 32"] | None = None
    mask_spread: Float[Tensor, "b 48 64"] | None = None


Network = TypeVar("Network", bound=nn.Module)


def channels_last(network: Network, device: torch.device) -> Network:
    """The network on the device, its weights in the order in which convolutions are quick."""
    return network.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]


def network_names() -> list[str]:
    """Names `build_network` knows."""
    return ["compact", "flownet2"]


def build_network(name: str, categories: int = 1) -> nn.Module:
    """A freshly initialised network for this many categories."""
    if name == "compact":
        from grasptransfer.perception.networks.compact import CompactFlowNet

        return CompactFlowNet(categories)
    if name == "flownet2":
        from grasptransfer.perception.networks.flownet2 import FlowNet2

        return FlowNet2()
    raise SettingsError("unknown network", key="network", value=name, choices=network_names())
