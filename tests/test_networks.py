"""Networks and their losses: features, batches, ensembles, and steps that help."""

import numpy as np
import pytest
import torch
from small_training_set import WIDTH

from grasptransfer.errors import SettingsError
from grasptransfer.perception.networks import Prediction, build_network
from grasptransfer.perception.networks.ensemble import Ensemble
from grasptransfer.perception.networks.picture_features import load_picture_features
from grasptransfer.workshop.training.augmentation import training_batch
from grasptransfer.workshop.training.dataset import Dataset
from grasptransfer.workshop.training.losses import training_loss


def test_picture_features_name_the_same_places_at_every_scale():
    features = load_picture_features()
    picture = torch.zeros(1, 3, 192, 256)
    picture[..., 128:, 192:] = 1
    changed = [(a - b).abs().sum(1)[0] for a, b in zip(features(picture), features(0 * picture), strict=True)]
    for stride, difference in zip((4, 8, 16, 32), changed, strict=True):
        assert difference.shape == (192 // stride, 256 // stride)
        assert difference[-1, -1] > 3 * difference[0, 0]
    assert not any(parameter.requires_grad for parameter in features.parameters())


def test_picture_features_stay_out_of_the_weight_file():
    network = build_network("compact")
    assert not any("picture_features" in name for name in network.state_dict())
    assert sum(p.numel() for p in network.parameters()) < 6e6


def test_a_picture_alone_gives_what_it_gives_in_a_batch():
    torch.manual_seed(0)
    network = build_network("compact", 2, WIDTH).eval()
    pictures, numbers = torch.rand(2, 8, 192, 256), torch.tensor([0, 1])
    with torch.inference_mode():
        together, alone = network(pictures, numbers), network(pictures[1:], numbers[1:])
    for whole, single in zip(together, alone, strict=True):
        assert (whole is None) == (single is None)
        if whole is not None:
            torch.testing.assert_close(whole[1:], single, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("loss", ["likelihood", "paper"])
def test_a_training_step_on_one_batch_lowers_its_loss(training_set, loss):
    torch.manual_seed(0)
    inputs, targets = training_batch(Dataset(training_set), np.arange(4), np.random.default_rng(0))
    network = build_network("compact", width=WIDTH)
    optimiser = torch.optim.AdamW(network.parameters(), 1e-3)
    values = []
    for _ in range(6):
        total = training_loss(network(*inputs), targets, loss)["total"]
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
        values.append(total.item())
    assert values[-1] < values[0]


def test_a_perfect_prediction_has_no_error(training_set):
    _, targets = training_batch(Dataset(training_set), np.arange(4), np.random.default_rng(0))
    zero = torch.zeros(4, 1, 24, 32)
    latent = targets["latent"]
    perfect = Prediction(
        targets["offset"],
        zero,
        targets["flow"],
        zero,
        (targets["mask"] - 0.5) * 100,
        latent,
        0 * latent,
        (targets["match"] - 0.5) * 100,
    )
    terms = training_loss(perfect, targets, "likelihood")
    assert terms["offset_mm"] < 0.02  # the square root is rounded off at zero
    assert terms["shape_mm"] < 0.02
    assert terms["iou"] == 1
    assert terms["match"] == 1


def test_an_ensemble_answers_with_the_mean_of_its_members():
    torch.manual_seed(0)
    members = [build_network("compact", 2, WIDTH).eval() for _ in range(3)]
    inputs = torch.rand(2, 8, 192, 256), torch.tensor([0, 1])
    with torch.inference_mode():
        together, alone = Ensemble(members)(*inputs), [member(*inputs) for member in members]
    for mean, parts in zip(together, zip(*alone, strict=True), strict=True):
        if None not in parts:  # How far its members differ is what an ensemble says besides.
            torch.testing.assert_close(mean, sum(parts) / 3)
    assert together.flow_spread is not None
    flows = torch.stack([one.flow for one in alone])
    torch.testing.assert_close(together.flow_spread, flows.std(0, correction=0).norm(dim=1))


def test_an_ensemble_lacks_what_its_members_lack():
    class Bare(torch.nn.Module):
        def picture_features(self, pictures):
            return None

        def forward(self, pictures, category, features):
            offset, scale, flow, flow_scale = (torch.ones(1, count, 24, 32) for count in (3, 1, 2, 1))
            return Prediction(offset, scale, flow, flow_scale, torch.ones(1, 1, 48, 64))

    together = Ensemble([Bare(), Bare()])(torch.zeros(1, 8, 192, 256), torch.zeros(1, dtype=torch.int64))
    assert together.latent is None
    assert (together.mask_logit == 1).all()


def test_an_unknown_loss_or_network_names_the_choices(training_set):
    _, targets = training_batch(Dataset(training_set), np.arange(1), np.random.default_rng(0))
    zero = torch.zeros(1, 1, 24, 32)
    prediction = Prediction(targets["offset"], zero, targets["flow"], zero, targets["mask"])
    with pytest.raises(SettingsError, match="paper"):
        training_loss(prediction, targets, "nonsense")
    with pytest.raises(SettingsError, match="compact"):
        build_network("nonsense")


def test_a_narrow_network_answers_as_a_whole_one_does_and_has_fewer_parameters():
    networks = [
        build_network(name, 2, width).eval() for name in ("compact", "flownet2") for width in (0.1, 0.2)
    ]
    sizes = [sum(parameter.numel() for parameter in network.parameters()) for network in networks]
    assert sizes[0] < sizes[1] < sizes[3]
    assert sizes[2] < sizes[3]
    whole = build_network("compact", 2).eval()
    inputs = torch.rand(1, 8, 192, 256), torch.tensor([1])
    with torch.inference_mode():
        for mine, full in zip(networks[0](*inputs), whole(*inputs), strict=True):
            assert (mine is None) == (full is None)
            assert mine is None or mine.shape == full.shape
