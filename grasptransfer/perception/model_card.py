"""The card beside each weight file: data, seed, command, time and scores."""

import csv
import os
from pathlib import Path

import torch

from grasptransfer.category import objects_folder
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.training import HELD_OUT_SEED, TrainingConfig

CURVE_ROWS = 12


def default_output(categories: tuple[str, ...]) -> Path:
    """Where the weights of a network for these categories go."""
    return objects_folder() / "models" / f"{'-'.join(sorted(categories))}.safetensors"


def write_card(
    weights: Path, config: TrainingConfig, scores: dict[str, float], confidence: Confidence, run_folder: Path
) -> Path:
    """Write `<weights>.md` and return its path."""
    path = weights.with_suffix(".md")
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(_card(weights, config, scores, confidence, run_folder), encoding="utf-8")
    os.replace(unfinished, path)
    return path


def _card(
    weights: Path, config: TrainingConfig, scores: dict[str, float], confidence: Confidence, run_folder: Path
) -> str:
    rows = _log(run_folder / "log.csv")
    parts = [
        f"# {weights.name}",
        _what_it_is(config, float(rows[-1]["seconds"]) / 3600 if rows else 0.0),
        f"## Held-out scores ({config.held_out} pictures of shapes that training never saw)",
        _table(
            ("measure", "value"),
            [
                ("mean offset error", f"{scores['offset_mm']:.2f} mm"),
                ("mean flow error", f"{scores['flow_px']:.2f} px of 256"),
                ("mean displacement error of the latent head", f"{scores['shape_mm']:.2f} mm"),
                ("mask IoU", f"{scores['iou']:.3f}"),
                ("objects of this and of other categories told apart", f"{scores['match']:.1%}"),
            ],
        ),
        "## Confidence\n\nFitted after training to other shapes and to strangers (`confidence.py`), "
        "and kept in the weight file: "
        + ", ".join(f"{name} {value:.3g}" for name, value in confidence.as_data().items())
        + ".",
        "## Curve (training batches)",
        _table(
            ("step", "offset [mm]", "flow [px]", "mask IoU"),
            [
                (row["step"], *(f"{float(row[name]):.3g}" for name in ("offset_mm", "flow_px", "iou")))
                for row in rows[:: max(len(rows) // CURVE_ROWS, 1)]
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _what_it_is(config: TrainingConfig, hours: float) -> str:
    parameters = sum(p.numel() for p in build_network(config.network, len(config.categories)).parameters())
    options = (
        f"--network {config.network} --loss {config.loss} --samples {config.samples} --steps {config.steps} "
        f"--batch {config.batch} --echo {config.echo} --learning-rate {config.learning_rate:g} "
        f"--seed {config.seed}"
    )
    return f"""\
Network `{config.network}` ({parameters / 1e6:.1f} M parameters, stored in half precision) for: \
{", ".join(config.categories)}.

- **Input**: observed RGB and its box, coordinates and mask of the model as assumed so far (pose and \
latent), zoomed to 256 x 192.
- **Output**: offset of each visible point of the model, its flow in the picture, the object's mask, what \
the assumed latent lacks, each with the scale of its error; whether the object is of the category.
- **Data**: {config.samples} pictures of random parametric shapes, rendered with random cameras, lights, \
materials and pose errors; backgrounds, occluders and camera faults are drawn anew in every batch. No \
photograph and no scan was used, but for the ImageNet pictures behind the picture features \
(EfficientNet-Lite0, kept as it is).
- **Seed**: {config.seed}; held-out shapes: seed {config.seed + HELD_OUT_SEED}.
- **Training**: {config.steps} steps of {config.batch}, {hours:.2f} h on {_device()}, bfloat16.
- **Command**: `grasptransfer train {" ".join(config.categories)} {options}`"""


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ("---",) * len(head), *rows))


def _log(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _device() -> str:
    if torch.cuda.is_available():
        return torch.cuda.get_device_name()
    return f"{os.cpu_count()} CPU cores"
