"""Networks that see the observed and the canonical picture and predict, per canonical pixel, how it moves.

Every network maps `(b, 8, 192, 256)` (observed RGB and box mask, coordinates and mask of the model as
assumed so far) and the number of each sample's category to a `Prediction`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from jaxtyping import Float

from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    from torch import nn

STRIDE = 8  # input pixels per cell of offsets and flow
CELL_PIXEL = 2  # which row and column of its pixels a cell stands for
OFFSET_UNIT = 0.01  # m: the networks predict offsets in centimetres, numbers near one
FLOW_UNIT = 10.0  # px of the zoomed picture
LATENT_SIZE = 40  # modes a network can speak of; a shape space with more keeps the rest at its prior


class Prediction(NamedTuple):
    """Network output; cell (i, j) belongs to zoomed pixel (u, v) = (8 j + 2, 8 i + 2).

    Arrays of PyTorch where a network is trained, of numpy where one answers (`answering.py`).

    Args:
        offset: how much farther the assumed model's point seen in the cell is displaced, view axes
            (`network_input.view_from_object`) [OFFSET_UNIT].
        offset_log_scale: logarithm of its Laplace scale [OFFSET_UNIT].
        flow: from the cell's pixel to where the point is observed [FLOW_UNIT].
        flow_log_scale: logarithm of its Laplace scale [FLOW_UNIT].
        mask_logit: logit that a pixel shows the observed object, at a quarter of the input's resolution.
        latent: what the assumed latent lacks, None from a network without this head.
        latent_log_scale: logarithm of the standard deviation of its error.
        match_logit: logit that the observed object is of the category.
        flow_spread: standard deviation of the flow among the members of an ensemble [FLOW_UNIT].
        mask_spread: standard deviation of the mask's probability among them.
    """

    offset: Float[Any, "b 3 24 32"]
    offset_log_scale: Float[Any, "b 1 24 32"]
    flow: Float[Any, "b 2 24 32"]
    flow_log_scale: Float[Any, "b 1 24 32"]
    mask_logit: Float[Any, "b 1 48 64"]
    latent: Float[Any, "b 40"] | None = None
    latent_log_scale: Float[Any, "b 40"] | None = None
    match_logit: Float[Any, " b"] | None = None
    flow_spread: Float[Any, "b 24 32"] | None = None
    mask_spread: Float[Any, "b 48 64"] | None = None


def network_names() -> list[str]:
    """Names `build_network` knows."""
    return ["compact", "flownet2"]


def build_network(name: str, categories: int = 1, width: float = 1.0) -> nn.Module:
    """A freshly initialised network.

    Args:
        name: one of `network_names`.
        categories: number of categories that it serves.
        width: factor on the number of channels of its layers.

    Raises:
        SettingsError: there is no such network.
    """
    if name == "compact":
        from grasptransfer.perception.networks.compact import CompactFlowNet

        return CompactFlowNet(categories, width)
    if name == "flownet2":
        from grasptransfer.perception.networks.flownet2 import FlowNet2

        return FlowNet2(width)
    raise SettingsError("unknown network", key="network", value=name, choices=network_names())
