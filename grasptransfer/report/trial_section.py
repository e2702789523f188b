"""What PyBullet made of the grasps, for the report."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from grasptransfer.report.html_parts import pill

if TYPE_CHECKING:
    from grasptransfer.report.studio import Studio
    from grasptransfer.simulation import TrialResult
    from grasptransfer.transfer import TransferResult


def executed_by_name(trials: "Sequence[TrialResult]") -> "dict[str, list[TrialResult]]":
    """Trials of each grasp."""
    grouped: dict[str, list] = {}
    for trial in trials:
        grouped.setdefault(trial.grasp, []).append(trial)
    return grouped


def trial_pill(trials: "Sequence[TrialResult]") -> str:
    """Outcome of one grasp's trials as a coloured word."""
    if not trials:
        return pill("not executed", "neutral")
    held = sum(trial.held for trial in trials)
    if len(trials) == 1:
        return pill(trials[0].status.value, "good" if held else "bad")
    return pill(f"held {held} of {len(trials)}", "good" if 2 * held > len(trials) else "bad")


def trial_section(result: "TransferResult", trials: "Sequence[TrialResult]", studio: "Studio") -> str:
    """Table and pictures of the trials."""
    return ""
