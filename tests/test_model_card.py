"""The card beside trained weights says what was trained, on what, and how well it does."""

import dataclasses

import pytest
import torch
from small_training_set import MUG

from grasptransfer.perception.confidence import Confidence
from grasptransfer.workshop.training import model_card
from grasptransfer.workshop.training import training as training_module
from grasptransfer.workshop.training.model_card import write_card
from grasptransfer.workshop.training.settings import TrainingConfig


@pytest.mark.parametrize("members", [1, 2])
def test_a_card_states_each_member_and_how_far_another_training_may_end_from_them(members, tmp_path):
    config = TrainingConfig((MUG,), members=members, steps=7, seed=5)
    scores = {"offset_mm": 6.0, "flow_px": 4.0, "shape_mm": 7.0, "iou": 0.9, "match": 0.99}
    every = [scores | {"offset_mm": offset} for offset in (5.5, 6.0, 6.4)]
    for number in range(members):
        folder = training_module.member_folder(tmp_path, number)
        folder.mkdir()
        (folder / "log.csv").write_text("step,seconds,offset_mm,flow_px,iou\n7,3600,9,8,0.7\n")
    scores = every[: members + 1]
    path = write_card(tmp_path / "w.safetensors", config, scores, Confidence(), tmp_path, precision="float32")
    card = path.read_text()
    assert f"{members}.00 h in all" in card
    assert "cores, float32" in card or torch.cuda.is_available()
    assert f"`grasptransfer train mug --network compact --width 1 --members {members} " in card
    assert "| 5.50 mm | 6.00 mm |" in card
    # Two standard deviations, 2 x 0.283, widened for a mean of two.
    assert ("mean offset error 6.20 mm ± 0.69 mm" in card) == (members == 2)
    assert ("mean flow error 4.00 px of 256 ± 0.08 px" in card) == (members == 2)


def test_the_curve_of_a_card_joins_members_by_step(tmp_path):
    row = {"seconds": "1", "offset_mm": "9", "flow_px": "8"}
    logs = [
        [row | {"step": str(step), "iou": f"0.{step}"} for step in steps] for steps in ((1, 2, 3), (1, 3))
    ]
    assert model_card._curve(logs) == [
        ("1", "9 / 8 / 0.1", "9 / 8 / 0.1"),
        ("3", "9 / 8 / 0.3", "9 / 8 / 0.3"),
    ]


def test_a_card_says_which_scores_are_of_trained_shapes(tmp_path):
    split = MUG.file.split.model_copy(update={"test": ()})
    file = MUG.file.model_copy(update={"name": "mycup", "split": split})
    own = dataclasses.replace(MUG, name="mycup", file=file, folder=tmp_path / "my cup")
    folder = training_module.member_folder(tmp_path, 0)
    folder.mkdir()
    (folder / "log.csv").write_text("step,seconds,offset_mm,flow_px,iou\n7,3600,9,8,0.7\n")
    scores = [{"offset_mm": 6.0, "flow_px": 4.0, "shape_mm": 7.0, "iou": 0.9, "match": 0.99}] * 2
    for categories in ((MUG,), (MUG, own)):
        config = TrainingConfig(categories, members=1, steps=7)
        path = write_card(
            tmp_path / "w.safetensors", config, scores, Confidence(), tmp_path, precision="float32"
        )
        card = path.read_text()
        assert ("of shapes that training never saw" in card) == (categories == (MUG,))
        assert ("those of mycup show shapes of training" in card) == (categories != (MUG,))
        assert ("random parametric shapes and the train instances of mycup" in card) == (categories != (MUG,))
    assert f"`grasptransfer train mug '{tmp_path}/my cup' " in card
