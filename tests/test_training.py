"""A training: resumable, prolonged, logged, and refusing what does not fit."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from small_training_set import MUG, SMALL, WIDTH, rebuilt

from grasptransfer.errors import SettingsError
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.weights import load_weights
from grasptransfer.workshop.training import training as training_module
from grasptransfer.workshop.training.augmentation import training_batch
from grasptransfer.workshop.training.dataset import Dataset
from grasptransfer.workshop.training.log import append_row, drop_rows_after, read_rows
from grasptransfer.workshop.training.settings import TrainingConfig
from grasptransfer.workshop.training.training import train_networks


class Killed(Exception):
    """A training was killed."""


@pytest.fixture
def train(training_set, tmp_path, monkeypatch):
    """Trains on the four samples, in the folder of that name; changes are of the settings."""
    data = Dataset(training_set)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))

    def train(name="run", *, on_step=None, output=None, categories=(MUG,), **changes):
        config = TrainingConfig(categories, **SMALL | changes)
        output = output or tmp_path / f"{name}.safetensors"
        return train_networks(
            config, run_folder=tmp_path / name, output=output, device="cpu", on_step=on_step
        )

    return train


def test_an_interrupted_training_ends_as_an_unbroken_one(train, tmp_path, monkeypatch):
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 1)
    monkeypatch.setattr(training_module, "LOGGED_STEPS", 1)

    def kill(progress):
        if progress.step == 3:  # after the checkpoint of the second step
            raise Killed

    whole = train("whole", steps=4)
    with pytest.raises(Killed):
        train("broken", steps=4, on_step=kill)
    assert not (tmp_path / "broken.safetensors").exists()
    resumed = train("broken", steps=4)
    assert resumed[0] == pytest.approx(whole[0], rel=1e-4)


def test_a_prolonged_run_ends_as_one_started_for_that_length(train, monkeypatch):
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 1)
    train("grown", steps=3)  # its rate has fallen since the second step
    grown, grown_alone = train("grown", steps=6, members=2)
    straight, straight_alone = train("straight", steps=6, members=2)
    assert grown == pytest.approx(straight, rel=1e-4)
    for one, other in zip(grown_alone, straight_alone, strict=True):
        assert one == pytest.approx(other, rel=1e-4)
    assert grown_alone[0]["offset_mm"] != grown_alone[1]["offset_mm"]


def test_a_run_folder_with_other_settings_is_refused(train, tmp_path):
    member = training_module.member_folder(tmp_path / "run", 0)
    member.mkdir(parents=True)
    torch.save({"config": json.dumps({"steps": 2, "seed": 1})}, member / "checkpoint.pt")
    with pytest.raises(SettingsError, match="other settings"):
        train()


def test_a_run_of_a_category_that_was_built_again_is_refused(train):
    train()
    with pytest.raises(SettingsError, match="other settings"):
        train(categories=(rebuilt(),))


def test_a_run_of_before_there_was_a_width_goes_on(train, tmp_path):
    train(width=1.0)
    path = training_module.member_folder(tmp_path / "run", 0) / training_module.FALLING_RATE
    state = torch.load(path, weights_only=True)
    state["config"] = json.dumps({k: v for k, v in json.loads(state["config"]).items() if k != "width"})
    torch.save(state, path)
    train(width=1.0)
    with pytest.raises(SettingsError, match="other settings"):
        train(width=WIDTH)


@pytest.mark.parametrize("batch", [3, 5])
def test_every_held_out_sample_counts_whatever_the_batch(training_set, monkeypatch, batch):
    seen = []

    def recorded(dataset, indices, rng):
        seen.extend(indices)
        return training_batch(dataset, indices, rng)

    monkeypatch.setattr(training_module, "training_batch", recorded)
    config = TrainingConfig((MUG,), **SMALL | {"batch": batch})
    network = build_network("compact", width=WIDTH)
    scores = training_module.evaluate(network, Dataset(training_set), config)
    assert seen == [0, 1, 2, 3]
    assert np.isfinite(list(scores.values())).all()


def test_one_step_is_a_training_and_its_weights_go_into_a_new_folder(train, tmp_path):
    output = tmp_path / "new" / "folder" / "a.safetensors"
    train(output=output)
    ensemble, info = load_weights(output)
    assert (len(ensemble.members), info.width) == (1, WIDTH)


def test_an_output_that_cannot_be_written_is_refused_before_training(train, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: pytest.fail("rendered"))
    with pytest.raises(SettingsError, match=r"a\.safetensors: cannot be written"):
        train(output=tmp_path / "file" / "a.safetensors")


def test_a_resumed_run_logs_every_step_once(train, tmp_path, monkeypatch):
    monkeypatch.setattr(training_module, "LOGGED_STEPS", 1)
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 2)

    def kill(progress):
        if progress.step == 3:  # logged, but after the last checkpoint
            raise Killed

    with pytest.raises(Killed):
        train(steps=4, on_step=kill)
    train(steps=4)
    rows = read_rows(training_module.member_folder(tmp_path / "run", 0))
    assert [row["step"] for row in rows] == ["1", "2", "3", "4"]


def test_a_log_without_checkpoint_is_begun_anew(tmp_path):
    for log in ("", "step,seconds,iou\n", "step,seconds,iou\n50,1.0,0.5\n"):
        (tmp_path / "log.csv").write_text(log)
        drop_rows_after(tmp_path, 0)
        append_row(tmp_path, 50, 1.0, {"iou": 0.6})
        assert read_rows(tmp_path) == [{"step": "50", "seconds": "1.0", "iou": "0.6"}]


def test_training_without_test_instances_warns(train, monkeypatch, caplog):
    monkeypatch.setattr(training_module, "without_held_out", lambda _: ["mycup"])
    train()
    assert "mycup has no test instances" in caplog.text


@pytest.mark.parametrize("width", [0, -1.0, float("nan"), float("inf")])
def test_a_width_that_is_none_is_refused(width):
    with pytest.raises(SettingsError, match="width"):
        dataclasses.replace(TrainingConfig((MUG,)), width=width)
