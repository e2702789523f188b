"""Several processes train one network."""

import json
import subprocess
import sys

import pytest
import torch
from small_training_set import MUG

from grasptransfer.errors import SettingsError
from grasptransfer.perception.weights import load_weights
from grasptransfer.workshop.training import training as training_module
from grasptransfer.workshop.training.dataset import Dataset
from grasptransfer.workshop.training.processes import Place, join_processes
from grasptransfer.workshop.training.settings import TrainingConfig
from grasptransfer.workshop.training.training import train_networks


@pytest.mark.parametrize(("device", "backend", "own"), [("cpu", "gloo", "cpu"), ("cuda", "nccl", "cuda:1")])
def test_a_process_joins_the_others_with_a_device_of_its_own(device, backend, own, monkeypatch):
    for name, value in {"RANK": 3, "WORLD_SIZE": 4, "LOCAL_RANK": 1}.items():
        monkeypatch.setenv(name, str(value))
    chosen, joined = [], []
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda: (8, 0))
    monkeypatch.setattr(torch.cuda, "set_device", chosen.append)
    monkeypatch.setattr(torch.distributed, "init_process_group", lambda *args, **_: joined.append(args))
    place = join_processes(device)
    assert (place.rank, place.world, place.device) == (3, 4, torch.device(own))
    assert joined == [(backend,)]
    assert chosen == ([] if device == "cpu" else [place.device])


def test_only_the_first_process_renders_and_the_others_wait_for_it(monkeypatch, tmp_path):
    done = []
    monkeypatch.setattr(torch.distributed, "barrier", lambda: done.append("waited"))
    monkeypatch.setattr(training_module, "build_dataset", lambda *_, **__: done.append("rendered"))
    monkeypatch.setattr(Dataset, "__init__", lambda *_: done.append("opened"))
    config = TrainingConfig((MUG,))
    for rank, rendered in ((0, ["rendered"] * 2), (1, [])):
        done.clear()
        training_module._data_sets(config, tmp_path, Place(rank, 2, torch.device("cpu")), 1, None)
        assert done == [*rendered, "waited", "opened", "opened"]


def test_a_batch_that_the_processes_cannot_share_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(training_module, "join_processes", lambda *_: Place(0, 3, torch.device("cpu")))
    places = {"run_folder": tmp_path / "run", "output": tmp_path / "a.safetensors"}
    with pytest.raises(SettingsError, match="batch"):
        train_networks(TrainingConfig((MUG,), batch=32), **places, device="cpu")


def test_two_processes_train_one_network(training_set, tmp_path):
    script = tmp_path / "train.py"
    script.write_text(TWO_PROCESSES)
    command = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(script)]
    subprocess.run([sys.executable, *command, str(training_set), str(tmp_path)], check=True)
    first, second = (json.loads((tmp_path / f"rank_{rank}.json").read_text()) for rank in (0, 1))
    # Each saw batches of its own, and yet they hold the same network.
    assert first["batch"] != second["batch"]
    assert first["scores"] == pytest.approx(second["scores"], rel=1e-6)
    ensemble, _ = load_weights(tmp_path / "w.safetensors")
    assert len(ensemble.members) == 2


TWO_PROCESSES = """
import json
import os
import sys
from pathlib import Path

import torch

from grasptransfer.category import load_category
from grasptransfer.workshop.training import training
from grasptransfer.workshop.training.dataset import Dataset
from grasptransfer.workshop.training.settings import TrainingConfig

torch.set_num_threads(1)
data, out = Dataset(Path(sys.argv[1])), Path(sys.argv[2])
training._data_sets = lambda *_: (data, data)
batches = []
whole_batch = training._Run.batch_of


def batch_of(run, number, dataset):
    batch = whole_batch(run, number, dataset)
    batches.append(float(batch[0][0].sum()))
    return batch


training._Run.batch_of = batch_of
small = {"width": 0.1, "samples": 4, "held_out": 4, "members": 2, "steps": 2, "batch": 2}
config = TrainingConfig((load_category("mug"),), **small)
places = {"run_folder": out / "run", "output": out / "w.safetensors"}
scores, _ = training.train_networks(config, **places, device="cpu")
result = {"scores": scores, "batch": batches[0]}
(out / f"rank_{os.environ['RANK']}.json").write_text(json.dumps(result))
"""
