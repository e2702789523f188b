"""The whole of a training: pictures, networks, their confidence and their card."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.device import choose_device
from grasptransfer.perception.precision import training_precision
from grasptransfer.workshop.training.confidence_fit import fit_confidence
from grasptransfer.workshop.training.model_card import default_output, write_card
from grasptransfer.workshop.training.settings import TrainingConfig, TrainingPlace
from grasptransfer.workshop.training.training import HELD_OUT_SEED, Scores, TrainingProgress, train_networks


@dataclass(frozen=True)
class Trained:
    """What a training left.

    Args:
        weights: the `.safetensors` file, with the confidence in it.
        card: the model card beside it; None in all processes of several but the first.
        scores: scores of the networks together, on held-out samples.
        members: scores of each network by itself.
        confidence: fitted after training; None where there is no card.
    """

    weights: Path
    card: Path | None
    scores: Scores
    members: tuple[Scores, ...]
    confidence: Confidence | None


def train(
    config: TrainingConfig,
    place: TrainingPlace | None = None,
    *,
    on_render: Callable[[int, int], None] | None = None,
    on_step: Callable[[TrainingProgress], None] | None = None,
    on_confidence: Callable[[int, int], None] | None = None,
) -> Trained:
    """Render what is missing, train networks, fit their confidence and write their card.

    Started again it goes on where a killed run stopped; with more steps or members, a finished run is
    prolonged. Of several processes (torchrun) the first one does all but its share of the training.

    Args:
        config: what the weights depend on.
        place: where it runs and what it writes; None takes the defaults.
        on_render: called with (shards done, in all).
        on_step: called as training goes on.
        on_confidence: called with (pictures done, in all) while the confidence is fitted.

    Raises:
        SettingsError: a run folder that holds a run with other settings, or a place that cannot be written.
    """
    place = place or TrainingPlace()
    output = place.output or default_output(config.categories)
    device = choose_device(place.device)
    precision = training_precision(place.precision, device)
    scores, alone = train_networks(
        config,
        run_folder=place.run,
        output=output,
        device=device,
        precision=precision,
        workers=place.workers,
        on_render=on_render,
        on_step=on_step,
    )
    members = tuple(alone)
    if int(os.environ.get("RANK", 0)):
        return Trained(output, None, scores, members, None)
    seed = config.seed + HELD_OUT_SEED
    confidence = fit_confidence(output, config.categories, seed=seed, progress=on_confidence)
    card = write_card(output, config, (scores, *members), confidence, place.run, precision=precision)
    return Trained(output, card, scores, members, confidence)
