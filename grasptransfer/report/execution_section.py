"""What the physics engine made of the grasps, for the report."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import trimesh

from grasptransfer.report.embedded import gif_uri
from grasptransfer.report.html import Figure
from grasptransfer.report.movie import movie, seconds_per_frame

if TYPE_CHECKING:
    from grasptransfer.drawing.studio import Studio
    from grasptransfer.result import TransferResult
    from grasptransfer.simulation import TrialResult

Word = tuple[str, str]  # a text, and the kind of word it is: good, bad or neutral


def outcome_of(grasp: str, trials: "Sequence[TrialResult]") -> Word:
    """Outcome of the trials of the grasp with this name, as a coloured word."""
    trials = [trial for trial in trials if trial.grasp == grasp]
    if not trials:
        return "not executed", "neutral"
    held = sum(trial.held for trial in trials)
    if len(trials) == 1:
        return trials[0].status.value, "good" if held else "bad"
    return f"held {held} of {len(trials)}", "good" if 2 * held > len(trials) else "bad"


def execution(
    result: "TransferResult",
    trials: "Sequence[TrialResult]",
    studio: "Studio",
    *,
    executed_mesh: trimesh.Trimesh | None,
    why: str = "",
) -> dict:
    """Values of the template's section on executed grasps: a table, and films of the recorded trials.

    Args:
        executed_mesh: what the grasps were executed on, object frame [m]; None: the reconstruction.
        why: one sentence on which grasps were executed and why those.
    """
    mesh = result.mesh if executed_mesh is None else executed_mesh
    rows = [
        {
            "grasp": trial.grasp,
            "status": trial.status.value,
            "kind": "good" if trial.held else "bad",
            "phase": trial.phase,
            "slip_mm": f"{trial.slip_mm:.1f}",
            "slip_degrees": f"{trial.slip_degrees:.1f}",
            "detail": trial.detail,
        }
        for trial in trials
    ]
    movies = []
    for trial in trials:
        frames = movie(trial, mesh, result.gripper, studio)
        if frames:
            uri = gif_uri(frames, seconds_per_frame=seconds_per_frame(trial))
            movies.append(Figure(uri, f"execution of {trial.grasp}", f"{trial.grasp}: {trial.status.value}"))
    return {
        "trials": rows,
        "movies": movies,
        "executed_on": "the reconstruction" if executed_mesh is None else "the true mesh of the instance",
        "executed_why": why,
        "protocols": ", ".join(sorted({trial.protocol for trial in trials})),
    }
