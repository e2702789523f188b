"""FlowNet2: its size is the published one, its parts do what they are named for, and it learns."""

import pytest
import torch

from grasptransfer.perception.networks import FLOW_UNIT
from grasptransfer.perception.networks.flownet2 import REACH, STEP, FlowNet2, correlation, warp
from grasptransfer.workshop.training.losses import training_loss

NARROW = 1 / 16


@pytest.fixture(scope="module")
def pictures():
    return torch.rand(2, 8, 192, 256, generator=torch.Generator().manual_seed(0)) * 2 - 1


def test_it_has_the_published_number_of_parameters():
    with torch.device("meta"):
        count = sum(parameter.numel() for parameter in FlowNet2().parameters())
    # FlowNet 2.0 has 162.5 million; one channel more in each picture and three in each estimate add a few.
    assert 160e6 < count < 167e6


def test_three_offsets_come_back_for_every_pixel_and_cell(pictures):
    torch.manual_seed(0)
    network = FlowNet2(NARROW).eval()
    torch.nn.init.normal_(network.fusion.answer.weight)
    with torch.inference_mode():
        whole, prediction = (
            network.full_resolution(pictures),
            network(pictures, torch.zeros(2, dtype=torch.int64)),
        )
    assert whole[:, :3].shape == (2, 3, 192, 256)
    assert prediction.offset.shape == (2, 3, 24, 32)
    assert prediction.flow.shape == (2, 2, 24, 32)
    assert prediction.mask_logit.shape == (2, 1, 48, 64)
    # Cell (i, j) stands for pixel (8 i + 2, 8 j + 2).
    torch.testing.assert_close(prediction.offset[:, :, 5, 7], whole[:, :3, 42, 58])


def test_training_steps_lower_the_loss(pictures):
    torch.manual_seed(0)
    network = FlowNet2(NARROW)
    pictures = pictures[:1]
    cells = torch.ones(1, 1, 24, 32)
    targets = {
        "offset": pictures[:, :3, ::8, ::8] * 0.2 + 1,
        "flow": pictures[:, 3:5, ::8, ::8] * 0.2 - 1,
        "valid": cells,
        "mask": (pictures[:, :1, ::4, ::4] > 0).float(),
        "match": torch.ones(1),
    }
    # The paper trains at 3e-5; a network this narrow bears more.
    optimiser = torch.optim.AdamW(network.parameters(), 1e-4)
    totals = []
    for _ in range(6):
        total = training_loss(network(pictures), targets, "likelihood")["total"]
        optimiser.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        totals.append(total.item())
    assert totals[-1] < totals[0]
    # The gradient reaches the first layer of the stack through every warp and the correlation.
    first_layer = next(network.first.stem.parameters())
    assert first_layer.grad is not None
    assert first_layer.grad.abs().sum() > 0


def test_correlation_is_the_mean_product_with_the_neighbours():
    generator = torch.Generator().manual_seed(1)
    first, second = (torch.randn(2, 3, 24, 32, generator=generator) for _ in range(2))
    found = correlation(first, second)
    side = 2 * REACH // STEP + 1
    assert found.shape == (2, side**2, 24, 32)
    down, right = -6, 14
    channel = (down + REACH) // STEP * side + (right + REACH) // STEP
    expected = (first[:, :, 10, 5] * second[:, :, 10 + down, 5 + right]).mean(1)
    torch.testing.assert_close(found[:, channel, 10, 5], expected)
    assert (found[:, channel, 3] == 0).all()  # six rows up there is nothing


def test_a_picture_warped_by_a_whole_shift_is_the_shifted_picture():
    picture = torch.randn(1, 4, 12, 20, generator=torch.Generator().manual_seed(2))
    flow = torch.zeros(1, 2, 12, 20)
    flow[:, 0], flow[:, 1] = 3 / FLOW_UNIT, -2 / FLOW_UNIT
    warped = warp(picture, flow)
    torch.testing.assert_close(warped[:, :, 2:, :-3], picture[:, :, :-2, 3:], atol=1e-4, rtol=1e-4)
    assert warped[:, :, 0].abs().max() < 1e-4
