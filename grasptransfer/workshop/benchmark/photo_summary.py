"""Means, spreads and wins of the photo benchmark."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from grasptransfer.perception.estimators import ESTIMATORS
from grasptransfer.workshop.benchmark.placed_boxes import mean_shares
from grasptransfer.workshop.benchmark.reliability import Chance, reliability_table, summarise_chances

SCORES = ("E", "silhouette_iou", "size_error")


def summarise_photos(rows: list[dict]) -> dict:
    """Wins of `rgb` photograph by photograph and object by object, and means per category."""
    summary: dict[str, object] = {"photos": len(rows), "objects": len({row["object"] for row in rows})}
    for other in ("rigid", "similarity"):
        against = [row for row in rows if other in row]
        wins = [_wins(row["rgb"], row[other]) for row in against]
        summary[f"rgb_beats_{other}"] = float(np.mean(wins)) if wins else None
        lost = [name for name, group in _groups(against, "object") if not _wins_object(group, other)]
        summary[f"objects_lost_to_{other}"] = len(lost)
        summary[f"lost_to_{other}"] = ", ".join(lost)
    for category, group in _groups(rows, "category"):
        for method in ESTIMATORS:
            for score in SCORES:
                values = [row[method][score] for row in group if score in row.get(method, {})]
                if values:
                    summary[f"{category}_{method}_{score}_mean"] = float(np.mean(values))
                    summary[f"{category}_{method}_{score}_std"] = float(np.std(values))
        ious = [row["mask_iou"] for row in group if row.get("mask_iou") is not None]
        if ious:
            summary[f"{category}_mask_iou_mean"] = float(np.mean(ious))
    for method in ESTIMATORS:
        summary |= _of_grasps(method, [row[method] for row in rows if "grasp_held" in row.get(method, {})])
    refused = sum(row.get("status") == "out_of_category" for row in rows)
    return summary | mean_shares(rows) | {"refused": refused}


def _of_grasps(method: str, executed: list[dict]) -> dict:
    """How often the best-ranked grasp held, how often it was said to, and those called usable."""
    if not executed:
        return {}
    stated = [one["grasp_stated"] for one in executed if one["grasp_stated"] is not None]
    best = [
        None if one["grasp_stated"] is None else Chance(one["grasp_stated"], one["grasp_held"])
        for one in executed
    ]
    every = [Chance(**chance) for one in executed for chance in one["executed"]]
    usable, held = (sum(one[key] for one in executed) for key in ("usable", "usable_held"))
    return {
        f"{method}_grasps_executed_photos": len(executed),
        f"{method}_grasp_held": float(np.mean([one["grasp_held"] for one in executed])),
        f"{method}_grasp_stated": float(np.mean(stated)) if stated else None,
        f"{method}_usable_precision": held / usable if usable else None,
        f"reliability_{method}": reliability_table(every),
        **summarise_chances(method, best, every),
    }


def _groups(rows: list[dict], key: str) -> Iterable[tuple[str, list[dict]]]:
    groups: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        groups[row[key]].append(row)
    return groups.items()


def _wins(ours: dict, theirs: dict) -> bool:
    score = "E" if "E" in ours else "size_error"
    return ours[score] < theirs[score]


def _wins_object(rows: list[dict], other: str) -> bool:
    """Lower in E and higher in silhouette IoU on average, or, without mesh, lower in size error."""

    def mean(method: str, score: str) -> float:
        return float(np.mean([row[method][score] for row in rows]))

    if "E" not in rows[0]["rgb"]:
        return mean("rgb", "size_error") < mean(other, "size_error")
    nearer = mean("rgb", "E") < mean(other, "E")
    return nearer and mean("rgb", "silhouette_iou") > mean(other, "silhouette_iou")
