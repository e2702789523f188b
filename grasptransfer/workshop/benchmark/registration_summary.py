"""Means, spreads and ratios of the registration benchmarks."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from grasptransfer.workshop.benchmark.errors_of_shape import ShapeError
from grasptransfer.workshop.benchmark.placed_boxes import mean_shares

ONE_VIEW = "rgb_one_view"  # in the rows: rgb on the first of several pictures alone
# Of rgb, one number a row.
OF_RGB = ("rgb_mask_iou", "pose_error_before_mm", "pose_error_after_mm", "pose_error_after_one_view_mm",
          "pose_error_before_deg", "pose_error_after_deg", "pose_error_after_one_view_deg")  # fmt: skip
TIE = 1.1  # Errors within ten per cent of those of CLS count as equally good.


@dataclass
class MethodScores:
    """One method on the views of one instance.

    Args:
        errors: errors of the shape, in the object's frame.
        placed: errors of the shape at its given or refined pose.
        correspondence_mm: mean distance of warped canonical points to their true places.
        covered: share of the modes within the 90 % interval.
        mask_ious: IoUs of the predicted mask.
        failed: views without answer.
    """

    errors: list[ShapeError] = field(default_factory=list)
    placed: list[ShapeError] = field(default_factory=list)
    correspondence_mm: list[float] = field(default_factory=list)
    covered: list[float] = field(default_factory=list)
    mask_ious: list[float] = field(default_factory=list)
    failed: int = 0

    def as_data(self) -> dict:
        """Mean and spread over the views; `E` lists every view."""
        values = np.array([error.E for error in self.errors])
        placed = np.array([error.E for error in self.placed])
        data = {
            "mean": float(values.mean()),
            "std": float(values.std()),
            "median": float(np.median(values)),
            "rms_mm": float(np.mean([error.rms_mm for error in self.errors])),
            "chamfer_mm": float(np.mean([error.chamfer_mm for error in self.errors])),
            "placed_mean": float(placed.mean()),
            "placed_std": float(placed.std()),
            "failed": self.failed,
            "E": [round(float(value), 3) for value in values],
        }
        if self.correspondence_mm:
            data["correspondence_mm"] = float(np.mean(self.correspondence_mm))
        if self.covered:
            data["coverage_90"] = float(np.mean(self.covered))
        return data


def summarise(rows: list[dict]) -> dict:
    """Ratios between methods, instance by instance, averaged; the same for each category."""
    summary = {"instances": len(rows), **_ratios(rows), **_means(rows)}
    per_category: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        per_category[row["category"]].append(row)
    if len(per_category) > 1:
        for category, group in per_category.items():
            kept = {key: value for key, value in _ratios(group).items() if "similarity" not in key}
            summary |= {f"{category}_{key}": value for key, value in {**kept, **_means(group)}.items()}
    return summary


def _means(rows: list[dict]) -> dict[str, float]:
    methods = [name for name, value in rows[0].items() if isinstance(value, dict) and "mean" in value]
    means = {f"E_{name}_mean": float(np.mean([row[name]["mean"] for row in rows])) for name in methods}
    for name in methods:
        failed = sum(row[name]["failed"] for row in rows)
        if failed:
            means[f"{name}_views_without_answer"] = failed
    for score in ("coverage_90", "correspondence_mm"):
        for name in ("rgb", "rgbd", "cls"):
            values = [row[name][score] for row in rows if name in row and score in row[name]]
            if values:
                means[f"{name}_{score}"] = float(np.mean(values))
    means |= mean_shares(rows)
    for key in OF_RGB:
        values = [row[key] for row in rows if key in row]
        if values:
            means["rgb_mask_iou_mean" if key == "rgb_mask_iou" else key] = float(np.mean(values))
    if ONE_VIEW in methods:
        means["rgb_E_mean_over_one_view"] = means["E_rgb_mean"] / means[f"E_{ONE_VIEW}_mean"]
    return means


def _ratios(rows: list[dict]) -> dict[str, float | int]:
    """Ratios of `rgb` to every other method."""
    found: dict[str, float | int] = {}
    for other in ("gt", "cpd", "cls", "rigid", "similarity"):
        pairs = [(row["rgb"], row[other]) for row in rows if "rgb" in row and other in row]
        if not pairs:
            continue
        ratios = [ours["mean"] / theirs["mean"] for ours, theirs in pairs]
        found[f"rgb_over_{other}_mean"] = float(np.mean(ratios))
        if other in ("gt", "cpd"):
            found[f"rgb_over_{other}_worst"] = float(np.max(ratios))
        if other == "cpd":
            found["rgb_beats_cpd"] = sum(ratio < 1 for ratio in ratios)
            spreads = [ours["std"] / max(theirs["std"], 1e-9) for ours, theirs in pairs]
            found["rgb_spread_over_cpd_mean"] = float(np.mean(spreads))
            found["rgb_spread_below_cpd"] = sum(spread < 1 for spread in spreads)
            medians = [ours["median"] / theirs["median"] for ours, theirs in pairs]
            found["rgb_over_cpd_median"] = float(np.mean(medians))
            placed = [ours["placed_mean"] / theirs["placed_mean"] for ours, theirs in pairs]
            found["rgb_over_cpd_placed_mean"] = float(np.mean(placed))
        if other == "cls":
            found["rgb_beats_or_ties_cls"] = sum(ratio <= TIE for ratio in ratios)
    return found
