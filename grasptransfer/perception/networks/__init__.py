"""Networks that see the observed and the canonical picture and predict, per canonical pixel, how it moves.

Every network maps `(b, 8, 192, 256)` (observed RGB and box mask, canonical coordinates and
mask) to a `Prediction`. They differ in size and speed only.
"""

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor, nn

from grasptransfer.errors import SettingsError

STRIDE = 8  # input pixels per cell of offsets and flow
CELL_PIXEL = 2  # which row and column of its pixels a cell stands for
MASK_STRIDE = 4
OFFSET_UNIT = 0.01  # m: the networks predict offsets in centimetres, numbers near one
FLOW_UNIT = 10.0  # px of the zoomed picture


class Prediction(NamedTuple):
    """Network output; cell (i, j) belongs to zoomed pixel (u, v) = (8 j + 2, 8 i + 2).

    Args:
        offset: displacement of the canonical point seen in the cell, view axes (`samples.view_from_object`)
            [OFFSET_UNIT].
        offset_log_scale: logarithm of its Laplace scale [OFFSET_UNIT].
        flow: from the canonical pixel to where the displaced point is observed [FLOW_UNIT].
        flow_log_scale: logarithm of its Laplace scale [FLOW_UNIT].
        mask_logit: of the observed object, at a quarter of the input's resolution.
    """

    offset: Float[Tensor, "b 3 24 32"]
    offset_log_scale: Float[Tensor, "b 1 24 32"]
    flow: Float[Tensor, "b 2 24 32"]
    flow_log_scale: Float[Tensor, "b 1 24 32"]
    mask_logit: Float[Tensor, "b 1 48 64"]


def network_names() -> list[str]:
    """Names `build_network` knows."""
    return ["compact"]


def build_network(name: str) -> nn.Module:
    """A freshly initialised network."""
    if name == "compact":
        from grasptransfer.perception.networks.compact import CompactFlowNet

        return CompactFlowNet()
    raise SettingsError("unknown network", key="network", value=name, choices=network_names())
