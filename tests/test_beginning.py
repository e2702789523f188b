"""A training begins with the shipped layers for a category that the networks do not know, else by chance."""

from dataclasses import replace

import pytest
import torch

from grasptransfer.category import load_category
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.weights import find_weights, load_weights
from grasptransfer.workshop.training.beginning import LATENT, begin_with_shipped
from grasptransfer.workshop.training.settings import TrainingConfig

MUG = load_category("mug")


@pytest.fixture
def network():
    torch.manual_seed(0)
    return build_network("compact", 1)


def test_a_new_category_begins_with_all_layers_of_a_shipped_network_but_the_latents(network):
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    begin_with_shipped(network, TrainingConfig((replace(MUG, name="cup"),)), 1)
    shipped = load_weights(find_weights(MUG))[0].members[1].state_dict()
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, before[name] if name in LATENT else shipped[name]), name


@pytest.mark.parametrize(
    "config",
    [
        TrainingConfig((MUG,)),
        TrainingConfig((replace(MUG, name="cup"),), scratch=True),
        TrainingConfig((replace(MUG, name="cup"),), width=0.5),
    ],
    ids=["known", "scratch", "of another width"],
)
def test_else_networks_begin_as_they_are_made(config, network):
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    begin_with_shipped(network, config, 0)
    assert all(torch.equal(tensor, before[name]) for name, tensor in network.state_dict().items())
