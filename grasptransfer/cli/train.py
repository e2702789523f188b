"""`grasptransfer train`: render pictures, train networks, fit their confidence, write their card."""

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from tyro.conf import Positional, arg

from grasptransfer.cli.progress import progress_bar
from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    from grasptransfer.workshop.training.training import Progress, TrainingConfig

console = Console(markup=False)


def train(
    categories: Positional[Annotated[tuple[str, ...], arg(metavar="[CATEGORY …]")]] = (),
    *,
    run: Path = Path("runs/default"),
    output: Path | None = None,
    network: str = "compact",
    members: int = 2,
    loss: str = "likelihood",
    samples: int = 20_000,
    steps: int = 10_000,
    batch: int = 32,
    echo: int = 2,
    learning_rate: float = 1e-3,
    seed: int = 0,
    device: str = "auto",
    precision: str = "auto",
    workers: int = 2,
) -> int:
    """Render training pictures and train networks; started again, it goes on where it stopped.

    Started again with more steps or members, a finished run is prolonged. The defaults made the
    shipped weights.

    Args:
        categories: names or folders, trained together; none given: all shipped ones.
        run: folder of data, checkpoints and logs.
        output: weight file; default: objects/models/<categories>.safetensors.
        network: see `grasptransfer.perception.networks`.
        members: networks trained alike but for the seed; their mean is the answer.
        loss: likelihood, or paper (squared offsets times 1000).
        samples: rendered training samples.
        steps: optimiser steps of each member.
        batch: samples a step.
        echo: how often each augmented batch is used; 2 halves what preparing them costs.
        learning_rate: peak; it falls over the last 30 % of the steps.
        seed: of everything random.
        device: auto, cpu or cuda.
        precision: auto, float32 or bfloat16; auto: as the processor has instructions for.
        workers: rendering processes.
    """
    from grasptransfer.category import list_categories, load_category
    from grasptransfer.perception.device import choose_device
    from grasptransfer.perception.precision import training_precision
    from grasptransfer.workshop.training.model_card import default_output
    from grasptransfer.workshop.training.training import TrainingConfig

    loaded = tuple(load_category(category) for category in categories or list_categories())
    config = TrainingConfig(
        loaded,
        network,
        members=members,
        loss=loss,
        samples=samples,
        steps=steps,
        batch=batch,
        echo=echo,
        learning_rate=learning_rate,
        seed=seed,
    )
    output = output or default_output(loaded)
    _check_choices(config)
    _check_numbers(config, workers)
    _check_places(run, output)
    device = choose_device(device)
    arithmetic = {"device": device, "precision": training_precision(precision, device)}
    _train_with_progress(config, output, run, arithmetic, workers)
    return 0


def _train_with_progress(
    config: "TrainingConfig", output: Path, run: Path, arithmetic: dict[str, str], workers: int
) -> None:
    from grasptransfer.workshop.training.confidence_fit import fit_confidence
    from grasptransfer.workshop.training.model_card import write_card
    from grasptransfer.workshop.training.training import HELD_OUT_SEED
    from grasptransfer.workshop.training.training import train as run_training

    with progress_bar(console) as progress:
        rendering = progress.add_task("rendering", total=None)
        training = progress.add_task("training", total=config.members * config.steps)
        scores, alone = run_training(
            config,
            run_folder=run,
            output=output,
            **arithmetic,
            workers=workers,
            on_render=lambda done, total: progress.update(rendering, completed=done, total=total),
            on_step=lambda state: progress.update(
                training, completed=state.step, description=_training_line(state)
            ),
        )
        if int(os.environ.get("RANK", 0)):
            return  # the first process of several does the rest
        fitting = progress.add_task("fitting confidence", total=None)
        confidence = fit_confidence(
            output,
            config.categories,
            seed=config.seed + HELD_OUT_SEED,
            progress=lambda done, total: progress.update(fitting, completed=done, total=total),
        )
    card = write_card(output, config, (scores, *alone), confidence, run, precision=arithmetic["precision"])
    console.print(f"Weights: {output}\nModel card: {card}\n{scores}", soft_wrap=True)


def _check_choices(config: "TrainingConfig") -> None:
    """Refuse, as the two checks below do, what would fail only after an hour of rendering."""
    from grasptransfer.perception.networks import network_names
    from grasptransfer.workshop.training.losses import LOSSES

    names = [category.name for category in config.categories]
    if len(set(names)) < len(names):
        raise SettingsError("names one category twice", key="categories", value=names)
    for key, choices in (("network", network_names()), ("loss", LOSSES)):
        value = getattr(config, key)
        if value not in choices:
            raise SettingsError(f"unknown {key}", key=key, value=value, choices=choices)


def _check_numbers(config: "TrainingConfig", workers: int) -> None:
    counts = {key: getattr(config, key) for key in ("members", "samples", "steps", "batch", "echo")}
    for key, value in {**counts, "workers": workers}.items():
        if value < 1:
            raise SettingsError("must be at least 1", key=key, value=value)
    if not 0 < config.learning_rate < math.inf:
        raise SettingsError("must be above 0", key="learning_rate", value=config.learning_rate)


def _check_places(run: Path, output: Path) -> None:
    from grasptransfer.report.result_files import check_folder

    check_folder(run, "run")
    if output.suffix != ".safetensors" or output.is_dir():
        raise SettingsError("must be a .safetensors file", key="output", value=str(output))


def _training_line(state: "Progress") -> str:
    terms = "  ".join(f"{name} {value:.3g}" for name, value in state.terms.items())
    return f"training  {state.samples_per_second:.0f}/s  {terms}"
