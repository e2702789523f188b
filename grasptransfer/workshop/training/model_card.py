"""The card beside each weight file: data, seed, command, time and scores."""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from grasptransfer.category import Category, objects_folder
from grasptransfer.files import write_whole
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.networks import build_network
from grasptransfer.workshop.training.log import read_rows
from grasptransfer.workshop.training.settings import TrainingConfig
from grasptransfer.workshop.training.training import HELD_OUT_SEED, Scores, member_folder
from grasptransfer.workshop.training.training_shapes import has_generator, without_held_out

CURVE_ROWS = 12
LEAST_SPREAD = 0.02
MEASURES = (  # of `training.Scores`: key, name, format
    ("offset_mm", "mean offset error", "{:.2f} mm"),
    ("flow_px", "mean flow error", "{:.2f} px of 256"),
    ("shape_mm", "mean displacement error of the latent head", "{:.2f} mm"),
    ("iou", "mask IoU", "{:.3f}"),
    ("match", "objects of this and of other categories told apart", "{:.1%}"),
)


def default_output(categories: Sequence[Category]) -> Path:
    """Where the weights of a network for these categories go."""
    names = sorted(category.name for category in categories)
    return objects_folder() / "models" / f"{'-'.join(names)}.safetensors"


def write_card(
    weights: Path,
    config: TrainingConfig,
    scores: Sequence[Scores],
    confidence: Confidence,
    run_folder: Path,
    *,
    precision: str,
) -> Path:
    """Write `<weights>.md` and return its path.

    Args:
        scores: scores of the ensemble, then of each member by itself.
        precision: "float32" or "bfloat16", of training.
    """
    path = weights.with_suffix(".md")
    write_whole(path, _card(weights, config, scores, confidence, run_folder, precision).encode())
    return path


def _card(
    weights: Path,
    config: TrainingConfig,
    scores: Sequence[Scores],
    confidence: Confidence,
    run_folder: Path,
    precision: str,
) -> str:
    logs = [read_rows(member_folder(run_folder, number)) for number in range(config.members)]
    hours = sum(float(log[-1]["seconds"]) for log in logs) / 3600
    members = tuple(f"member {number}" for number in range(config.members))
    parts = [
        f"# {weights.name}",
        _what_it_is(config, hours, precision),
        f"## Held-out scores ({config.held_out} pictures{_of_which(config.categories)})",
        _table(
            ("measure", "together", *members),
            [(what, *(show.format(one[key]) for one in scores)) for key, what, show in MEASURES],
        ),
        _spread(scores[1:]),
        "## Confidence\n\nFitted after training to other shapes and to wrong inputs (`confidence.py`), "
        "and kept in the YAML file beside the weights: verdicts, preferences of poses, and overconfidence "
        f"{confidence.overconfidence:.3g}.",
        "## Curve (training batches: offset [mm], flow [px], mask IoU)",
        _table(("step", *members), _curve(logs)),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _spread(alone: Sequence[Scores]) -> str:
    """How far another training may end from the members' mean: two standard deviations of the members."""
    if len(alone) < 2:
        return ""
    parts: list[str] = []
    for key, what, show in MEASURES:
        values = np.array([one[key] for one in alone])
        spread = 2 * values.std(ddof=1) * np.sqrt(1 + 1 / len(alone))
        shown = (show.format(number) for number in (values.mean(), max(spread, LEAST_SPREAD * values.mean())))
        parts.append(f"{what} {' ± '.join(shown)}")
    return (
        "Members differ in their seed alone. A network of another training is expected at: "
        + ", ".join(parts)
        + " (two standard deviations of the members; few can agree by chance, so never below "
        + f"{LEAST_SPREAD:.0%})."
    )


def _curve(logs: list[list[dict[str, str]]]) -> list[tuple[str, ...]]:
    shown = ("offset_mm", "flow_px", "iou")
    members = [
        {row["step"]: " / ".join(f"{float(row[name]):.3g}" for name in shown) for row in log} for log in logs
    ]
    steps = [step for step in members[0] if all(step in member for member in members)]
    every = max(len(steps) // CURVE_ROWS, 1)
    return [(step, *(member[step] for member in members)) for step in steps[::every]]


def _what_it_is(config: TrainingConfig, hours: float, precision: str) -> str:
    network = build_network(config.network, len(config.categories), config.width)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    meshes = _of_meshes(config.categories)
    options = (
        f"--network {config.network} --width {config.width:g} --members {config.members} "
        f"--loss {config.loss} "
        f"--samples {config.samples} --steps {config.steps} --batch {config.batch} --echo {config.echo} "
        f"--learning-rate {config.learning_rate:g} --seed {config.seed}"
    )
    return f"""\
{config.members} networks `{config.network}` ({parameters / 1e6:.1f} M parameters each, stored in half \
precision), whose mean is the answer, for: {", ".join(category.name for category in config.categories)}.

- **Input**: observed RGB and its box, coordinates and mask of the model as assumed so far (pose and \
latent), zoomed to 256 x 192.
- **Output**: offset of each visible point of the model, its flow in the picture, the object's mask, what \
the assumed latent lacks, each with the scale of its error; whether the object is of the category.
- **Data**: {config.samples} pictures of {_shown(config.categories)}, rendered with random cameras, lights, \
materials and pose errors; backgrounds, occluders and camera faults are drawn anew in every batch. No \
photograph {"" if meshes else "and no scan "}was used, but for the ImageNet pictures behind the picture \
features (EfficientNet-Lite0, kept as it is).
- **Seed**: {config.seed} (member i: {config.seed} + i); held-out shapes: seed {config.seed + HELD_OUT_SEED}.
- **Training**: {config.steps} steps of {config.batch} each, {hours:.2f} h in all on {_device()}, {precision}.
- **Command**: `grasptransfer train {_given(config.categories)} {options}`"""


def _shown(categories: Sequence[Category]) -> str:
    """What the training pictures show."""
    meshes = _of_meshes(categories)
    shapes = [] if len(meshes) == len(categories) else ["random parametric shapes"]
    return " and ".join(shapes + [f"the train instances of {name}" for name in meshes])


def _of_which(categories: Sequence[Category]) -> str:
    """Whether the held-out pictures show what training never saw."""
    trained = without_held_out(categories)
    if not trained:
        return " of shapes that training never saw"
    return (
        f"; without test instances, those of {', '.join(trained)} show shapes of training, "
        "as those do that its confidence was fitted to"
    )


def _of_meshes(categories: Sequence[Category]) -> list[str]:
    return [category.name for category in categories if not has_generator(category)]


def _given(categories: Sequence[Category]) -> str:
    """The categories as the command takes them: shipped ones by name, others by folder."""
    shipped = objects_folder()
    return shlex.join(
        category.name if category.folder == shipped / category.name else str(category.folder)
        for category in categories
    )


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ("---",) * len(head), *rows))


def _device() -> str:
    if torch.cuda.is_available():
        return torch.cuda.get_device_name()
    return f"{os.cpu_count()} CPU cores"
