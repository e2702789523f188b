"""Data sets, networks, weights and training: reproducible, resumable, and refusing what is corrupt."""

import dataclasses
import json
import shutil
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch

from grasptransfer.category import load_category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError, WeightsError
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.networks import Prediction, build_network
from grasptransfer.perception.networks.ensemble import Ensemble
from grasptransfer.perception.networks.picture_features import load_picture_features
from grasptransfer.perception.weights import WeightsInfo, load_weights, save_weights, trained_on
from grasptransfer.registration import DisplacementModel
from grasptransfer.workshop.training import dataset as dataset_module
from grasptransfer.workshop.training import model_card
from grasptransfer.workshop.training import training as training_module
from grasptransfer.workshop.training.augmentation import network_input, training_batch
from grasptransfer.workshop.training.dataset import Dataset, DatasetConfig, build_dataset
from grasptransfer.workshop.training.log import append_row, drop_rows_after, read_rows
from grasptransfer.workshop.training.losses import training_loss
from grasptransfer.workshop.training.model_card import write_card
from grasptransfer.workshop.training.processes import Place, join_processes
from grasptransfer.workshop.training.samples import render_sample
from grasptransfer.workshop.training.scenes import NO_NOISE
from grasptransfer.workshop.training.settings import TrainingConfig
from grasptransfer.workshop.training.training import train_networks
from grasptransfer.workshop.training.training_shapes import draw_training_shape, training_canonical

MUG = load_category("mug")
CONFIG = DatasetConfig((MUG,), samples=4, seed=3, backgrounds=2, sprites=2)


@pytest.fixture(scope="module")
def small_shards():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset_module, "SHARD", 4)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_shards):
    return _build(tmp_path_factory.mktemp("data"))


def _build(parent):
    # In this process: the shortened shard length would not reach a spawned one.
    target = parent / CONFIG.digest()
    target.mkdir()
    (target / "config.json").write_text(json.dumps(CONFIG.as_data()))
    dataset_module._write_sprites(CONFIG, target)
    dataset_module._write_backgrounds(CONFIG, target)
    dataset_module._write_shard(CONFIG, target, 0)
    return target


def test_a_data_set_is_reproducible(folder, tmp_path):
    again = _build(tmp_path)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*.npy"))
    assert len(files) == 11
    for file in files:
        first, second = np.load(folder / file).astype(float), np.load(again / file).astype(float)
        # The renderer's threads may round a colour one way or the other; nothing else may differ.
        tolerance = 2 if file.name in ("observed.npy", "sprites.npy", "backgrounds.npy") else 0
        np.testing.assert_allclose(first, second, rtol=0, atol=tolerance, err_msg=str(file))


def test_a_complete_data_set_is_not_rendered_again(folder):
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.npy")}
    build_dataset(CONFIG, folder.parent, workers=1)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.npy")} == before


def test_a_data_set_is_completed_after_a_kill_and_its_leftovers_are_removed(tmp_path, monkeypatch):
    target = _build(tmp_path)
    shutil.rmtree(target / "00000.shard")
    real = np.save

    class Killed(BaseException):
        pass

    def kill(path, array):
        if path.stem == "flow":
            raise Killed
        real(path, array)

    with monkeypatch.context() as patch:
        patch.setattr(np, "save", kill)
        patch.setattr(shutil, "rmtree", lambda *_, **__: None)  # a killed run clears nothing up
        with pytest.raises(Killed):
            dataset_module._write_shard(CONFIG, target, 0)
    leftovers = [path for path in target.iterdir() if path.name.startswith(".")]
    assert leftovers
    build_dataset(CONFIG, tmp_path, workers=0)
    assert len(Dataset(target)) == 4
    assert not any(path.exists() for path in leftovers)


def test_true_motion_of_an_unmoved_canonical_is_zero():
    canonical = training_canonical(MUG)
    rng = np.random.default_rng(0)
    shape = draw_training_shape(canonical, MUG.train, rng)
    rest = canonical.mesh.vertices
    still = dataclasses.replace(
        shape, scene=canonical.mesh, vertices=rest, move=lambda p, f: (p, np.ones(len(p), bool))
    )
    model = DisplacementModel(0 * canonical.model.mean, 0 * canonical.model.basis)
    unmoved = dataclasses.replace(canonical, model=model)
    with Renderer() as renderer:
        sample = render_sample(still, unmoved, rng, renderer=renderer, noise=NO_NOISE)
    assert sample is not None
    assert sample.valid.sum() > 50
    assert (sample.offset[sample.valid] == 0).all()
    # The ray through a pixel's centre returns to it.
    assert np.abs(sample.flow[sample.valid]).max() < 1e-3


def test_the_input_has_eight_channels_and_an_untold_box_is_empty():
    observed = np.full((1, 192, 256, 3), 255, np.uint8)
    inputs = network_input(observed, np.full((1, 4), np.nan, np.float32), np.zeros_like(observed))
    assert inputs.shape == (1, 8, 192, 256)
    assert (inputs[:, :3] == 1).all()
    assert (inputs[:, 3:] == -1).all()


def test_the_latent_of_a_training_shape_explains_its_motion():
    canonical = training_canonical(MUG)
    far, left = [], []
    for seed in range(5):
        shape = draw_training_shape(canonical, MUG.train, np.random.default_rng(seed))
        moved, known = _moved_vertices(shape, canonical)
        mean_shape = canonical.vertices(np.zeros(canonical.n_modes))
        far.append(np.linalg.norm((moved - mean_shape)[known], axis=1).mean())
        left.append(np.linalg.norm((moved - canonical.vertices(shape.latent))[known], axis=1).mean())
    assert np.mean(left) < 0.35 * np.mean(far)


def _moved_vertices(shape, canonical):
    faces = canonical.mesh.faces
    face_of = np.zeros(len(canonical.mesh.vertices), int)
    face_of[faces.ravel()] = np.repeat(np.arange(len(faces)), 3)
    return shape.move(np.asarray(canonical.mesh.vertices), face_of)


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
    network = build_network("compact", 2).eval()
    pictures, numbers = torch.rand(2, 8, 192, 256), torch.tensor([0, 1])
    with torch.inference_mode():
        together, alone = network(pictures, numbers), network(pictures[1:], numbers[1:])
    for whole, single in zip(together, alone, strict=True):
        torch.testing.assert_close(whole[1:], single, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("loss", ["likelihood", "paper"])
def test_a_training_step_on_one_batch_lowers_its_loss(folder, loss):
    torch.manual_seed(0)
    inputs, targets = training_batch(Dataset(folder), np.arange(4), np.random.default_rng(0))
    network = build_network("compact")
    optimiser = torch.optim.AdamW(network.parameters(), 1e-3)
    values = []
    for _ in range(6):
        total = training_loss(network(*inputs), targets, loss)["total"]
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
        values.append(total.item())
    assert values[-1] < values[0]


def test_a_perfect_prediction_has_no_error(folder):
    _, targets = training_batch(Dataset(folder), np.arange(4), np.random.default_rng(0))
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
    members = [build_network("compact", 2).eval() for _ in range(3)]
    inputs = torch.rand(2, 8, 192, 256), torch.tensor([0, 1])
    with torch.inference_mode():
        together, alone = Ensemble(members)(*inputs), [member(*inputs) for member in members]
    for mean, parts in zip(together, zip(*alone, strict=True), strict=True):
        torch.testing.assert_close(mean, sum(parts) / 3)


def test_an_ensemble_lacks_what_its_members_lack():
    class Bare(torch.nn.Module):
        def picture_features(self, pictures):
            return None

        def forward(self, pictures, category, features):
            return Prediction(*[torch.ones(1)] * 5)

    together = Ensemble([Bare(), Bare()])(torch.zeros(1, 8, 192, 256), torch.zeros(1, dtype=torch.int64))
    assert together.latent is None
    assert together.mask_logit == 1


def test_an_unknown_loss_or_network_names_the_choices(folder):
    _, targets = training_batch(Dataset(folder), np.arange(1), np.random.default_rng(0))
    zero = torch.zeros(1, 1, 24, 32)
    prediction = Prediction(targets["offset"], zero, targets["flow"], zero, targets["mask"])
    with pytest.raises(SettingsError, match="paper"):
        training_loss(prediction, targets, "nonsense")
    with pytest.raises(SettingsError, match="compact"):
        build_network("nonsense")


def test_weights_come_back_as_they_were_saved(tmp_path):
    torch.manual_seed(1)
    network = Ensemble(build_network("compact") for _ in range(2)).eval()
    save_weights(tmp_path / "w.safetensors", network, WeightsInfo("compact", {"mug": trained_on(MUG)}))
    loaded, info = load_weights(tmp_path / "w.safetensors")
    assert info == WeightsInfo("compact", {"mug": trained_on(MUG)})
    for name, tensor in loaded.state_dict().items():
        torch.testing.assert_close(tensor, network.state_dict()[name].half().float())


@pytest.mark.parametrize("position", [20, -1000])
def test_a_flipped_byte_in_the_weights_is_found(tmp_path, position):
    path = tmp_path / "w.safetensors"
    save_weights(path, Ensemble([build_network("compact")]), WeightsInfo("compact", {"mug": trained_on(MUG)}))
    data = bytearray(path.read_bytes())
    data[position] ^= 255
    path.write_bytes(data)
    with pytest.raises(WeightsError, match=r"w\.safetensors"):
        load_weights(path)


def test_missing_weights_say_how_to_train_them(tmp_path):
    with pytest.raises(WeightsError, match="grasptransfer train"):
        load_weights(tmp_path / "none.safetensors")


def test_an_interrupted_training_ends_as_an_unbroken_one(folder, tmp_path, monkeypatch):
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=4, batch=2)
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 1)
    whole = train_networks(
        config, run_folder=tmp_path / "whole", output=tmp_path / "a.safetensors", device="cpu"
    )

    class Killed(Exception):
        pass

    def kill(run):
        if run.step == 2:
            raise Killed

    original = training_module._Run.save
    monkeypatch.setattr(training_module._Run, "save", lambda run: (original(run), kill(run)))
    with pytest.raises(Killed):
        train_networks(
            config, run_folder=tmp_path / "broken", output=tmp_path / "b.safetensors", device="cpu"
        )
    assert not (tmp_path / "b.safetensors").exists()
    monkeypatch.setattr(training_module._Run, "save", original)
    resumed = train_networks(
        config, run_folder=tmp_path / "broken", output=tmp_path / "b.safetensors", device="cpu"
    )
    assert resumed[0] == pytest.approx(whole[0], rel=1e-4)


def test_a_prolonged_run_ends_as_one_started_for_that_length(folder, tmp_path, monkeypatch):
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 1)

    def run(name, steps, members):
        config = TrainingConfig((MUG,), samples=4, held_out=4, members=members, steps=steps, batch=2)
        return train_networks(
            config, run_folder=tmp_path / name, output=tmp_path / f"{name}.safetensors", device="cpu"
        )

    run("grown", 3, 1)  # its rate has fallen since the second step
    (grown, grown_alone), (straight, straight_alone) = run("grown", 6, 2), run("straight", 6, 2)
    assert grown == pytest.approx(straight, rel=1e-4)
    for one, other in zip(grown_alone, straight_alone, strict=True):
        assert one == pytest.approx(other, rel=1e-4)
    assert grown_alone[0]["offset_mm"] != grown_alone[1]["offset_mm"]


def test_a_run_folder_with_other_settings_is_refused(folder, tmp_path, monkeypatch):
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    member = training_module.member_folder(tmp_path / "run", 0)
    member.mkdir(parents=True)
    torch.save({"config": json.dumps({"steps": 2, "seed": 1})}, member / "checkpoint.pt")
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=2, batch=2)
    with pytest.raises(SettingsError, match="other settings"):
        train_networks(config, run_folder=tmp_path / "run", output=tmp_path / "a.safetensors", device="cpu")


def _tiny_run(folder, tmp_path, monkeypatch, **changes):
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    settings: dict[str, Any] = {"samples": 4, "held_out": 4, "members": 1, "steps": 1, "batch": 2} | changes
    output = settings.pop("output", tmp_path / "a.safetensors")
    config = TrainingConfig((MUG,), **settings)
    return train_networks(config, run_folder=tmp_path / "run", output=output, device="cpu")


@pytest.mark.parametrize("batch", [3, 5])
def test_every_held_out_sample_counts_whatever_the_batch(folder, tmp_path, monkeypatch, batch):
    seen = []

    def looked_at(dataset, indices, rng):
        seen.extend(indices)
        return training_batch(dataset, indices, rng)

    monkeypatch.setattr(training_module, "training_batch", looked_at)
    config = TrainingConfig((MUG,), samples=4, held_out=4, batch=batch)
    scores = training_module.evaluate(build_network("compact"), Dataset(folder), config)
    assert seen == [0, 1, 2, 3]
    assert np.isfinite(list(scores.values())).all()


def test_one_step_is_a_training(folder, tmp_path, monkeypatch):
    _tiny_run(folder, tmp_path, monkeypatch, steps=1)
    assert (tmp_path / "a.safetensors").is_file()


def test_weights_go_into_a_new_folder(folder, tmp_path, monkeypatch):
    _tiny_run(folder, tmp_path, monkeypatch, output=tmp_path / "new" / "folder" / "a.safetensors")
    assert (tmp_path / "new" / "folder" / "a.safetensors").is_file()


def test_an_output_that_cannot_be_written_is_refused_before_training(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: pytest.fail("rendered"))
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=1, batch=2)
    with pytest.raises(SettingsError, match=r"a\.safetensors: cannot be written"):
        train_networks(
            config, run_folder=tmp_path / "run", output=tmp_path / "file" / "a.safetensors", device="cpu"
        )


def _rebuilt(file="shape_space.npz"):
    """The mugs as they would be after a build that changed this file."""
    checksums = MUG.file.checksums | {file: "another"}
    return dataclasses.replace(MUG, file=MUG.file.model_copy(update={"checksums": checksums}))


def test_data_of_a_category_that_was_built_again_is_not_used(tmp_path):
    for file in ("canonical.glb", "shape_space.npz", "fields.npz"):
        assert dataclasses.replace(CONFIG, categories=(_rebuilt(file),)).digest() != CONFIG.digest()
    moved = dataclasses.replace(MUG, folder=tmp_path)
    assert dataclasses.replace(CONFIG, categories=(moved,)).digest() == CONFIG.digest()


def test_a_run_of_a_category_that_was_built_again_is_refused(folder, tmp_path, monkeypatch):
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=2, batch=2)
    places = {"run_folder": tmp_path / "run", "output": tmp_path / "a.safetensors"}
    train_networks(config, **places, device="cpu")
    with pytest.raises(SettingsError, match="other settings"):
        train_networks(dataclasses.replace(config, categories=(_rebuilt(),)), **places, device="cpu")


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
    assert f"`grasptransfer train mug --network compact --members {members} " in card
    assert "| 5.50 mm | 6.00 mm |" in card
    # Two standard deviations, 2 x 0.283, widened for a mean of two.
    assert ("mean offset error 6.20 mm ± 0.69 mm" in card) == (members == 2)
    assert ("mean flow error 4.00 px of 256 ± 0.08 px" in card) == (members == 2)


def test_a_resumed_run_logs_every_step_once(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(training_module, "LOGGED_STEPS", 1)
    monkeypatch.setattr(training_module, "CHECKPOINT_STEPS", 2)

    class Killed(Exception):
        pass

    def kill(progress):
        if progress.step == 3:  # logged, but after the last checkpoint
            raise Killed

    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=4, batch=2)
    places = {"run_folder": tmp_path / "run", "output": tmp_path / "a.safetensors", "device": "cpu"}
    with pytest.raises(Killed):
        train_networks(config, **places, on_step=kill)
    train_networks(config, **places)
    rows = read_rows(training_module.member_folder(tmp_path / "run", 0))
    assert [row["step"] for row in rows] == ["1", "2", "3", "4"]


def test_a_log_without_checkpoint_is_begun_anew(tmp_path):
    for log in ("", "step,seconds,iou\n", "step,seconds,iou\n50,1.0,0.5\n"):
        (tmp_path / "log.csv").write_text(log)
        drop_rows_after(tmp_path, 0)
        append_row(tmp_path, 50, 1.0, {"iou": 0.6})
        assert read_rows(tmp_path) == [{"step": "50", "seconds": "1.0", "iou": "0.6"}]


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


def test_training_without_test_instances_warns(folder, tmp_path, monkeypatch, caplog):
    data = Dataset(folder)
    monkeypatch.setattr(training_module, "_data_sets", lambda *_: (data, data))
    monkeypatch.setattr(training_module, "without_held_out", lambda _: ["mycup"])
    config = TrainingConfig((MUG,), samples=4, held_out=4, members=1, steps=2, batch=2)
    train_networks(config, run_folder=tmp_path / "run", output=tmp_path / "a.safetensors", device="cpu")
    assert "mycup has no test instances" in caplog.text


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


def test_two_processes_train_one_network(folder, tmp_path):
    script = tmp_path / "train.py"
    script.write_text(TWO_PROCESSES)
    command = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(script)]
    subprocess.run([sys.executable, *command, str(folder), str(tmp_path)], check=True, timeout=300)
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
config = TrainingConfig((load_category("mug"),), samples=4, held_out=4, members=2, steps=2, batch=2)
places = {"run_folder": out / "run", "output": out / "w.safetensors"}
scores, _ = training.train_networks(config, **places, device="cpu")
result = {"scores": scores, "batch": batches[0]}
(out / f"rank_{os.environ['RANK']}.json").write_text(json.dumps(result))
"""
