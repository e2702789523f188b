"""Shares of the proposals of `bench pose` that are right, and the chances fitted to them."""

import numpy as np

from grasptransfer.errors import SettingsError
from grasptransfer.perception.pose_search.chances import chances_path, fit_weights_of_traits, write_chances

RIGHT_DEGREES = 16.0  # a proposal this near is right: a fit from it ends at the truth
BARS = {"deg10_cm10": (10.0, 0.10), "deg5_cm5": (5.0, 0.05)}


def summarise_poses(rows: list[dict]) -> dict:
    """Shares within the bars, of the likeliest proposal and of the best of each list."""
    summary: dict = {"pictures": len(rows), "without_proposal": sum(not row["proposals"] for row in rows)}
    summary |= _shares(rows)
    categories = list(dict.fromkeys(row["category"] for row in rows))
    for category in categories if len(categories) > 1 else []:
        own = [row for row in rows if row["category"] == category]
        summary |= {f"{category}_{key}": value for key, value in _shares(own).items()}
    return summary


def _shares(rows: list[dict]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, (degrees, metres) in BARS.items():
        good = [[one["degrees"] <= degrees and one["metres"] <= metres for one in row["proposals"]]
                for row in rows]  # fmt: skip
        found[name] = float(np.mean([bool(one and one[0]) for one in good]))
        found[f"{name}_best_of_list"] = float(np.mean([any(one) for one in good]))
    ious = [[one["iou"] for one in row["proposals"]] or [0.0] for row in rows]
    found["iou50"] = float(np.mean([one[0] >= 0.5 for one in ious]))
    found["iou50_best_of_list"] = float(np.mean([max(one) >= 0.5 for one in ious]))
    turns = [[one["degrees"] for one in row["proposals"]] or [180.0] for row in rows]
    right = [[degrees < RIGHT_DEGREES for degrees in one] for one in turns]
    found["right"] = float(np.mean([one[0] for one in right]))
    found["right_best_of_list"] = float(np.mean([any(one) for one in right]))
    found["stated"] = float(
        np.mean([row["proposals"][0]["chance"] if row["proposals"] else 0 for row in rows])
    )
    found["proposals_mean"] = float(np.mean([len(row["proposals"]) for row in rows]))
    found["seconds_median"] = float(np.median([row["seconds"] for row in rows]))
    return found


def write_fit(rows: list[dict]) -> None:
    """Fit the chances, and the deviations of right proposals, and write them."""
    evidence = [row["evidence"] for row in rows]
    views = fit_weights_of_traits(
        [np.array(one["views"]) for one in evidence],
        [np.array(one["views_right"]) for one in evidence],
        none=False,
    )
    answered = [one for one in evidence if one["poses"]]
    poses = fit_weights_of_traits(
        [np.array(one["poses"]) for one in answered],
        [np.array(one["poses_right"]) for one in answered],
        none=True,
    )
    right = [one for row in rows for one in row["proposals"] if one["degrees"] < RIGHT_DEGREES]
    if not right:
        raise SettingsError("not one proposal is right: nothing can be fitted", key="random")

    def deviation(key: str, axes: int) -> float:
        return float(np.sqrt(np.mean(np.square([one[key] for one in right])) / axes))

    spreads = {"along_ray": deviation("along_ray", 1), "across_ray": deviation("across_ray", 2),
               "turn": deviation("degrees", 3)}  # fmt: skip
    write_chances(chances_path(), views, poses, spreads)
