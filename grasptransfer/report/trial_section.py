"""What PyBullet made of the grasps, for the report."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import trimesh

from grasptransfer.report.html_parts import figure, gif_uri, pill, section, table
from grasptransfer.report.movie import movie, seconds_per_frame

if TYPE_CHECKING:
    from grasptransfer.report.studio import Studio
    from grasptransfer.result import TransferResult
    from grasptransfer.simulation import TrialResult


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


def trial_section(
    result: "TransferResult",
    trials: "Sequence[TrialResult]",
    studio: "Studio",
    *,
    executed_mesh: trimesh.Trimesh | None,
) -> str:
    """Table of the trials, and moving pictures of the recorded ones."""
    mesh = result.mesh if executed_mesh is None else executed_mesh
    what = "the reconstruction" if executed_mesh is None else "the true mesh of the instance"
    names = ("grasp", "outcome", "ended in", "slip mm", "slip °", "detail")
    heads = [(name, name.startswith("slip")) for name in names]
    rows = [
        [
            escape(trial.grasp),
            pill(trial.status.value, "good" if trial.held else "bad"),
            escape(trial.phase),
            f"{trial.slip_mm:.1f}",
            f"{trial.slip_degrees:.1f}",
            escape(trial.detail),
        ]
        for trial in trials
    ]
    movies = []
    for trial in trials:
        frames = movie(trial, mesh, result.gripper, studio)
        if frames:
            uri = gif_uri(frames, seconds_per_frame=seconds_per_frame(trial))
            caption = f"{escape(trial.grasp)}: {escape(trial.status.value)}"
            movies.append(figure(uri, caption, alt=f"execution of {trial.grasp}"))
    protocols = ", ".join(sorted({trial.protocol for trial in trials}))
    lead = f"Executed in PyBullet on {what}, protocol {escape(protocols)}."
    pictures = f'<div class="movies">{"".join(movies)}</div>' if movies else ""
    return section("Execution", lead, table(heads, rows) + pictures)
