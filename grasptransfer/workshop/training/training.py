"""Training: one process or several (torchrun), CPU or CUDA, resumable after a kill."""

import json
import logging
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch.nn.parallel import DistributedDataParallel

from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing, writing
from grasptransfer.perception.device import choose_device
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.networks.ensemble import Ensemble, channels_last
from grasptransfer.perception.precision import arithmetic
from grasptransfer.perception.weights import WeightsInfo, save_weights, trained_on
from grasptransfer.workshop.training.augmentation import Inputs, training_batch
from grasptransfer.workshop.training.beginning import begin_with_shipped
from grasptransfer.workshop.training.dataset import Dataset, DatasetConfig, build_dataset, state_of
from grasptransfer.workshop.training.log import append_row, drop_rows_after
from grasptransfer.workshop.training.losses import training_loss
from grasptransfer.workshop.training.prefetch import prefetch
from grasptransfer.workshop.training.processes import Place, join_processes
from grasptransfer.workshop.training.schedule import ECHO_WINDOW, batch_number, decay_start, learning_rate
from grasptransfer.workshop.training.settings import TrainingConfig
from grasptransfer.workshop.training.training_shapes import without_held_out

logger = logging.getLogger(__name__)

CHECKPOINT_STEPS, LOGGED_STEPS = 250, 50
FULL_RATE, FALLING_RATE = "checkpoint.pt", "checkpoint_falling.pt"  # before and while the rate falls
HELD_OUT_SEED = 1_000_003  # held-out shapes come from another seed than the training ones


Scores = dict[str, float]  # mean errors on the held-out samples


@dataclass(frozen=True)
class TrainingProgress:
    """What a run reports as it goes; steps are counted over all members."""

    step: int
    steps: int
    terms: dict[str, float]
    samples_per_second: float


def train_networks(
    config: TrainingConfig,
    *,
    run_folder: Path,
    output: Path,
    device: str = "auto",
    precision: str = "auto",
    workers: int = 2,
    on_render: Callable[[int, int], None] | None = None,
    on_step: Callable[[TrainingProgress], None] | None = None,
) -> tuple[Scores, list[Scores]]:
    """Render what is missing, train (or go on where a killed run stopped) and write the weights.

    Args:
        run_folder: data sets, and for each member a folder with checkpoints and a log.
        output: the `.safetensors` file, replaced once training is complete.
        precision: "auto", "float32" or "bfloat16".

    Warns of categories of which nothing is held out. `train` is the whole, with confidence and model card.

    Returns:
        Scores of the ensemble, and of each member by itself: how far those differ is what another
        training may differ by.
    """
    place = join_processes(choose_device(device), precision)
    if config.batch % place.world:
        raise SettingsError("must be a multiple of the number of processes", key="batch", value=config.batch)
    with writing(run_folder):
        run_folder.mkdir(parents=True, exist_ok=True)
    _check_writable(output)
    if place.first:
        for name in without_held_out(config.categories):
            logger.warning("%s has no test instances: its scores and confidence are of trained shapes", name)
    training_set, held_out_set = _data_sets(config, run_folder / "data", place, workers, on_render)
    members: list[torch.nn.Module] = []
    for number in range(config.members):
        run = _Run(config, number, run_folder, place)
        run.finish(training_set, on_step)
        members.append(run.network)
    ensemble = Ensemble(members)
    if place.first:
        trained = {category.name: trained_on(category) for category in config.categories}
        save_weights(output, ensemble, WeightsInfo(config.network, trained, width=config.width))
    alone = [evaluate(member, held_out_set, config, precision=place.precision) for member in members]
    return evaluate(ensemble, held_out_set, config, precision=place.precision), alone


def _check_writable(output: Path) -> None:
    """Refuse before hours of training what could not be written after them; folders above it are made."""
    with writing(output):
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=output.parent):
            pass


def member_folder(run_folder: Path, number: int) -> Path:
    """Where a member's checkpoints and log lie."""
    return run_folder / f"member_{number}"


def evaluate(
    network: torch.nn.Module, held_out: Dataset, config: TrainingConfig, *, precision: str = "float32"
) -> Scores:
    """Mean held-out terms over all samples, with augmentation of a fixed seed.

    Args:
        network: the network to evaluate.
        held_out: samples of shapes that training does not see.
        config: loss and batch size.
        precision: "float32" or "bfloat16".
    """
    rng = np.random.default_rng(HELD_OUT_SEED)
    network.eval()
    device = next(network.parameters()).device
    collected: list[dict[str, float]] = []
    parts = np.split(np.arange(len(held_out)), range(config.batch, len(held_out), config.batch))
    with torch.inference_mode():
        for part in parts:
            (pictures, numbers), targets = training_batch(held_out, part, rng)
            targets = {name: value.to(device) for name, value in targets.items()}
            with arithmetic(device, precision):
                prediction = network(pictures.to(device), numbers.to(device))
            collected.append(
                {k: v.item() for k, v in training_loss(prediction, targets, config.loss).items()}
            )
    network.train()
    sizes = [len(part) for part in parts]
    return {
        name: float(np.average([terms[name] for terms in collected], weights=sizes)) for name in collected[0]
    }


class _Run:
    """Network and optimiser of one member, restored from its last checkpoint."""

    def __init__(self, config: TrainingConfig, member: int, folder: Path, place: Place):
        self.config, self.member, self.folder = config, member, member_folder(folder, member)
        self.place = place
        self.seed = config.seed + member
        self.folder.mkdir(exist_ok=True)
        torch.manual_seed(self.seed)
        self.network = build_network(config.network, len(config.categories), config.width)
        begin_with_shipped(self.network, config, member)
        channels_last(self.network, place.device)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        self.step, self.seconds = 0, 0.0
        self._restore()
        self.parallel = DistributedDataParallel(self.network) if place.world > 1 else self.network

    def finish(self, dataset: Dataset, on_step: Callable[[TrainingProgress], None] | None):
        """All steps that are left, logged and saved as they go."""
        numbers = [batch_number(step, self.config.echo) for step in range(self.step, self.config.steps)]
        batches = prefetch(lambda number: self.batch_of(number, dataset), numbers, reuse=ECHO_WINDOW)
        clock, since = time.monotonic(), self.step
        recent: list[dict[str, torch.Tensor]] = []
        for inputs, targets in batches:
            terms = self.advance(inputs, targets)
            if not self.place.first:
                continue
            recent.append(terms)
            if self.step % LOGGED_STEPS == 0 or self.step == self.config.steps:
                spent = time.monotonic() - clock
                speed = (self.step - since) * self.config.batch / spent
                clock, since, self.seconds = clock + spent, self.step, self.seconds + spent
                values = {
                    name: float(np.mean([terms[name].item() for terms in recent])) for name in recent[0]
                }
                recent.clear()
                append_row(self.folder, self.step, self.seconds, values)
                if on_step:
                    done, total = self.member * self.config.steps, self.config.members * self.config.steps
                    on_step(TrainingProgress(done + self.step, total, values, speed))
            if self.step % CHECKPOINT_STEPS == 0 or self.step == self.config.steps:
                self.save()

    def batch_of(self, number: int, dataset: Dataset):
        # Every batch follows from its number alone, so a resumed run sees what an unbroken one would.
        rng = np.random.default_rng([self.seed, 4, number, self.place.rank])
        indices = rng.integers(len(dataset), size=self.config.batch // self.place.world)
        return training_batch(dataset, np.sort(indices), rng)

    def advance(self, inputs: Inputs, targets: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        device = self.place.device
        pictures = inputs[0].to(device, memory_format=torch.channels_last)
        targets = {name: value.to(device) for name, value in targets.items()}
        with arithmetic(device, self.place.precision):
            prediction = self.parallel(pictures, inputs[1].to(device))
        terms = training_loss(prediction, targets, self.config.loss)
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.step, self.config.steps, self.config.learning_rate)
        self.optimiser.zero_grad(set_to_none=True)
        terms["total"].backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        self.step += 1
        return {name: value.detach() for name, value in terms.items()}

    def save(self):
        state = {
            "config": json.dumps(self._settings()),
            "step": self.step,
            "seconds": self.seconds,
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        name = FULL_RATE if self.step <= decay_start(self.config.steps) else FALLING_RATE
        with replacing(self.folder / name) as unfinished:
            torch.save(state, unfinished)

    def _restore(self):
        state = self._latest_checkpoint()
        if state is not None:
            self.network.load_state_dict(state["network"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step, self.seconds = state["step"], state["seconds"]
        if self.place.first:
            drop_rows_after(self.folder, self.step)

    def _settings(self) -> dict:
        """What this member depends on: how many others there are does not matter."""
        settings = {field.name: getattr(self.config, field.name) for field in fields(self.config)}
        settings |= state_of(self.config.categories) | {"seed": self.seed}
        del settings["members"]
        return settings

    def _latest_checkpoint(self) -> dict | None:
        """The newest checkpoint that an unbroken run with these settings would have passed.

        Until the learning rate falls, a run is the same whatever number of steps it was started for.
        """
        own = json.loads(json.dumps(self._settings()))
        for name in (FALLING_RATE, FULL_RATE):
            path = self.folder / name
            if not path.exists():
                continue
            state = torch.load(path, map_location=self.place.device, weights_only=True)
            other = {"width": 1.0} | json.loads(state["config"])  # Older checkpoints do not state it.
            if {**other, "steps": 0} != {**own, "steps": 0}:
                raise SettingsError(
                    "holds a run with other settings",
                    path=path,
                    fix="Choose another run folder, or delete this one",
                )
            if other == own or (name == FULL_RATE and state["step"] <= decay_start(self.config.steps)):
                return state
        return None


def _data_sets(
    config: TrainingConfig, folder: Path, place: Place, workers: int, on_render
) -> tuple[Dataset, Dataset]:
    """Training and held-out samples; the first process renders what is missing while the others wait."""
    training = DatasetConfig(config.categories, config.samples, config.seed)
    held_out = DatasetConfig(
        config.categories,
        config.held_out,
        config.seed + HELD_OUT_SEED,
        backgrounds=200,
        sprites=120,
        held_out=True,
    )
    if place.first:
        for part in (training, held_out):
            build_dataset(part, folder, workers=workers, progress=on_render)
    if place.world > 1:
        torch.distributed.barrier()
    return Dataset(folder / training.digest()), Dataset(folder / held_out.digest())
