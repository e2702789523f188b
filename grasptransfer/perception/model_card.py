"""The card beside each weight file: data, seed, command, time and scores."""

import csv
import os
from pathlib import Path

import torch

from grasptransfer.category import objects_folder
from grasptransfer.perception.networks import build_network
from grasptransfer.perception.training import HELD_OUT_SEED, TrainingConfig

CURVE_ROWS = 12


def default_output(categories: tuple[str, ...]) -> Path:
    """Where the weights of a network for these categories go."""
    return objects_folder() / "models" / f"{'-'.join(sorted(categories))}.safetensors"


def write_card(weights: Path, config: TrainingConfig, scores: dict[str, float], run_folder: Path) -> Path:
    """Write `<weights>.md` and return its path."""
    path = weights.with_suffix(".md")
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(_card(weights, config, scores, run_folder), encoding="utf-8")
    os.replace(unfinished, path)
    return path


def _card(weights: Path, config: TrainingConfig, scores: dict[str, float], run_folder: Path) -> str:
    parameters = sum(p.numel() for p in build_network(config.network, len(config.categories)).parameters())
    rows = _log(run_folder / "log.csv")
    hours = float(rows[-1]["seconds"]) / 3600 if rows else 0.0
    options = (
        f"--network {config.network} --loss {config.loss} --samples {config.samples} --steps {config.steps} "
        f"--batch {config.batch} --echo {config.echo} --learning-rate {config.learning_rate:g} "
        f"--seed {config.seed}"
    )
    lines = [
        f"# {weights.name}",
        "",
        f"Network `{config.network}` ({parameters / 1e6:.1f} M parameters, stored in half precision) for: "
        f"{', '.join(config.categories)}.",
        "",
        "- **Input**: observed RGB and its box, coordinates and mask of the model as assumed so far (pose "
        "and latent), zoomed to 256 x 192.",
        "- **Output**: offset of each visible point of the model, its flow in the picture, the object's "
        "mask, what the assumed latent lacks, each with the scale of its error; whether the object is of the "
        "category.",
        f"- **Data**: {config.samples} pictures of random parametric shapes, rendered with random cameras, "
        "lights, materials and pose errors; backgrounds, occluders and camera faults are drawn anew in every "
        "batch. No photograph and no scan was used, but for the ImageNet pictures behind the picture "
        "features (EfficientNet-Lite0, kept as it is).",
        f"- **Seed**: {config.seed}; held-out shapes: seed {config.seed + HELD_OUT_SEED}.",
        f"- **Training**: {config.steps} steps of {config.batch}, {hours:.2f} h on {_device()}, bfloat16.",
        f"- **Command**: `grasptransfer train {' '.join(config.categories)} {options}`",
        "",
        f"## Held-out scores ({config.held_out} pictures of shapes that training never saw)",
        "",
        "| measure | value |",
        "| --- | --- |",
        f"| mean offset error | {scores['offset_mm']:.2f} mm |",
        f"| mean flow error | {scores['flow_px']:.2f} px of 256 |",
        f"| mean displacement error of the latent head | {scores['shape_mm']:.2f} mm |",
        f"| mask IoU | {scores['iou']:.3f} |",
        f"| objects of this and of other categories told apart | {scores['match']:.1%} |",
        "",
        "## Curve (training batches)",
        "",
        "| step | offset [mm] | flow [px] | mask IoU |",
        "| --- | --- | --- | --- |",
    ]
    for row in rows[:: max(len(rows) // CURVE_ROWS, 1)]:
        values = (float(row[name]) for name in ("offset_mm", "flow_px", "iou"))
        lines.append(f"| {row['step']} | " + " | ".join(f"{value:.3g}" for value in values) + " |")
    return "\n".join(lines) + "\n"


def _log(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _device() -> str:
    if torch.cuda.is_available():
        return torch.cuda.get_device_name()
    return f"{os.cpu_count()} CPU cores"
