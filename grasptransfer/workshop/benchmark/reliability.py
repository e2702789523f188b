"""How true stated chances are: shares held beside them, with their intervals, ECE and the Brier score.

| symbol | name | meaning |
| --- | --- | --- |
| p_i, y_i | `stated`, `held` | stated chance of an executed grasp, and whether it held (0 or 1) |
| B | `mean((p - y)^2)` | Brier score; 0.25 is that of always stating one half |
| ECE | `sum_b n_b / n * abs(mean p - mean y)` | expected calibration error over the bins b of the table |

Bins hold equal numbers of grasps, so that no bin's share rests on two or three of them. Few grasps make ECE
large by chance alone: with n of them in a bin a true share of one half is missed by 0.4 / sqrt(n) on average.

Sources: Brier 1950; Naeini, Cooper and Hauskrecht 2015 (ECE); Nguyen and O'Connor 2015 (bins of equal
numbers); Wilson 1927 (intervals).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasptransfer.simulation import wilson_interval

BINS = 10


@dataclass(frozen=True)
class Chance:
    """One executed grasp.

    Args:
        stated: its score before it was executed.
        held: whether it held.
    """

    stated: float
    held: bool


def reliability_table(chances: Sequence[Chance], *, bins: int = BINS) -> list[dict]:
    """The share of held grasps beside the stated one, lowest scores first.

    Returns:
        Rows of `from`, `to` (lowest and highest score), `grasps`, `stated` (mean), `held` (share), and `low`
        and `high` of the share's 95 % interval.
    """
    ordered = sorted(chances, key=lambda chance: chance.stated)
    rows = []
    for group in np.array_split(np.arange(len(ordered)), min(bins, len(ordered)) or 1):
        if not len(group):
            continue
        stated = [ordered[i].stated for i in group]
        held = sum(ordered[i].held for i in group)
        low, high = wilson_interval(held, len(group))
        rows.append(
            {
                "from": stated[0],
                "to": stated[-1],
                "grasps": len(group),
                "stated": float(np.mean(stated)),
                "held": held / len(group),
                "low": low,
                "high": high,
            }
        )
    return rows


def expected_calibration_error(chances: Sequence[Chance], *, bins: int = BINS) -> float | None:
    """Mean distance between stated and held over all grasps, bin by bin; None without grasps."""
    if not chances:
        return None
    rows = reliability_table(chances, bins=bins)
    return float(sum(row["grasps"] * abs(row["stated"] - row["held"]) for row in rows) / len(chances))


def brier_score(chances: Sequence[Chance]) -> float | None:
    """Mean squared distance of stated chances from what happened; None without grasps."""
    if not chances:
        return None
    return float(np.mean([(chance.stated - chance.held) ** 2 for chance in chances]))


def summarise_chances(name: str, best: Sequence[Chance | None], executed: Sequence[Chance]) -> dict:
    """The keys that every benchmark with executed grasps writes for an estimator.

    Args:
        name: of the estimator.
        best: of every picture its best-ranked grasp; None where none was usable, which counts as lost.
        executed: every executed grasp that the gripper reaches on the reconstruction.
    """
    tried = [chance for chance in best if chance is not None]
    held = sum(chance.held for chance in tried)
    low, high = wilson_interval(held, len(best))
    return {
        f"best_ranked_held_{name}": held / len(best) if best else None,
        f"best_ranked_held_{name}_low": low,
        f"best_ranked_held_{name}_high": high,
        f"stated_{name}": float(np.mean([chance.stated for chance in tried])) if tried else None,
        f"ece_{name}": expected_calibration_error(executed),
        f"brier_{name}": brier_score(executed),
        f"brier_best_ranked_{name}": brier_score(tried),
    }
