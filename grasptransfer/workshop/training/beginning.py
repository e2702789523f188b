"""What a training begins with: random weights, or the shipped networks, which know how objects move."""

import logging

import torch
from torch import nn

from grasptransfer.category import objects_folder
from grasptransfer.perception.weights import StoredWeights, read_weights
from grasptransfer.workshop.training.settings import TrainingConfig

LOG = logging.getLogger(__name__)
LATENT = ("latent.weight", "latent.bias")  # the layer whose rows belong to one category each


def begin_with_shipped(network: nn.Module, config: TrainingConfig, member: int) -> None:
    """Give a fresh network the layers of a shipped one, where the settings say so and one is of its kind.

    Rows of the latent's layer belong to a category each: those of a new one stay as they begin.
    """
    stored = None if config.scratch else _shipped(config)
    if stored is None:
        return
    prefix = f"members.{member % stored.members}."
    known = {
        name.removeprefix(prefix): torch.from_numpy(tensor).float()
        for name, tensor in stored.tensors.items()
        if name.startswith(prefix)
    }
    state = network.state_dict()
    network.load_state_dict(state | {name: t for name, t in known.items() if name not in LATENT})
    LOG.info("Member %d begins with the layers of the shipped networks.", member)


def _shipped(config: TrainingConfig) -> StoredWeights | None:
    """The shipped weights of this kind of network, if they know none of the categories."""
    names = {category.name for category in config.categories}
    for path in sorted((objects_folder() / "models").glob("*.safetensors")):
        stored = read_weights(path)
        kind = (stored.info.network, stored.info.width)
        if kind == (config.network, config.width) and not names & set(stored.info.categories):
            return stored
    return None
