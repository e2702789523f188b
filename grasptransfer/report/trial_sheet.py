"""A few executed trials in one picture: a line for each, from the way in to the turn in the air."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Int

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.sheet import encoded, sheet
from grasptransfer.drawing.studio import GROUND, Studio
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.frames import rotation_angle
from grasptransfer.report.movie import movie

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper
    from grasptransfer.simulation import TrialResult
    from grasptransfer.simulation.outcome import Recording

ON_THE_WAY = 0.6  # share of the way in at which the approach is shown
MOMENTS = ("on the way in", "closed", "lifted", "turned")


@dataclass(frozen=True)
class ExecutedTrial:
    """A recorded trial, and on what it was executed.

    Args:
        trial: with its recording.
        mesh: object frame [m].
        caption: written below it.
    """

    trial: "TrialResult"
    mesh: trimesh.Trimesh
    caption: str


def trial_sheet(path: str | Path, trials: Sequence[ExecutedTrial], gripper: "Gripper") -> Path:
    """Write a PNG with a line for each trial: approach, closed, lifted, turned; red fingers lost the object.

    Raises:
        SettingsError: no trials, one without a recording, or the file cannot be written.
    """
    path = Path(path)
    if not trials or any(one.trial.recording is None for one in trials):
        raise SettingsError("there is no recorded trial to draw", key="trials", path=path)
    with Renderer() as renderer:
        lines = [_frames(one, gripper, Studio(renderer)) for one in trials]
    captions = [text for one in trials for text in (one.caption, *[""] * (len(MOMENTS) - 1))]
    frames = [frame for line in lines for frame in line]
    page = sheet(frames, len(MOMENTS), captions=captions, heads=MOMENTS, ground=GROUND)
    write_whole(path, encoded(page))
    return path


def _frames(one: ExecutedTrial, gripper: "Gripper", studio: Studio) -> list[np.ndarray]:
    recording = one.trial.recording
    assert recording is not None, "trial_sheet looked"
    return movie(one.trial, one.mesh, gripper, studio, moments=_moments(recording, gripper.base_link))


def _moments(recording: "Recording", base_link: str) -> Int[np.ndarray, "t"]:
    """On the way in, when the fingers have closed, at the top, and in the widest turn or at the end."""
    phases = np.array(recording.phases)

    def during(phase: str) -> np.ndarray:
        return np.flatnonzero(phases == phase)

    last = len(phases) - 1
    approach, closing, lift, turn = (during(phase) for phase in ("approach", "close", "lift", "turn"))
    start = approach[round(ON_THE_WAY * (len(approach) - 1))] if len(approach) else 0
    closed = closing[-1] if len(closing) else last
    lifted = lift[-1] if len(lift) else last
    hand = recording.world_from_link[base_link][:, :3, :3]
    angles = [rotation_angle(hand[lifted].T @ hand[moment]) for moment in turn]
    turned = turn[int(np.argmax(angles))] if len(turn) else last
    return np.array([start, closed, lifted, turned])
