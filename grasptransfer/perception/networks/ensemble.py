"""Several networks trained alike from other beginnings: what each errs by itself, their mean errs less."""

from collections.abc import Iterable
from typing import TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from grasptransfer.perception.networks import Prediction

Network = TypeVar("Network", bound=nn.Module)


def channels_last(network: Network, device: torch.device) -> Network:
    """The network on the device, its weights in the order in which convolutions are quick."""
    return network.to(device).to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]


class Ensemble(nn.Module):
    """The mean of its members' predictions; every weight file holds one.

    Args:
        members: networks of one kind, for the same categories; at least one.
    """

    def __init__(self, members: Iterable[nn.Module]):
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, pictures: Float[Tensor, "b 8 192 256"], category: Int[Tensor, "b"]) -> Prediction:
        """Predict as a single network does, in single precision, and how far the members differ."""
        # Of the picture alone: made once for all members.
        features = self.members[0].picture_features(pictures)  # pyright: ignore[reportCallIssue]
        predictions = [member(pictures, category, features) for member in self.members]
        parts = [_mean(parts) for parts in zip(*predictions, strict=True)]
        mean = Prediction(*parts)  # pyright: ignore[reportArgumentType]: what no network lacks is not None
        flows = torch.stack([each.flow.float() for each in predictions])
        masks = torch.stack([torch.sigmoid(each.mask_logit.float()) for each in predictions])
        return mean._replace(
            flow_spread=flows.var(0, correction=0).sum(1).sqrt(),
            mask_spread=masks.std(0, correction=0)[:, 0],
        )


def _mean(parts: tuple[Tensor | None, ...]) -> Tensor | None:
    """None where the kind of network lacks a head."""
    present = [part.float() for part in parts if part is not None]
    return torch.stack(present).mean(0) if present else None
