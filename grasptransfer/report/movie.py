"""Moving pictures of a recorded trial: the true mesh and the gripper, from a side that shows both fingers."""

import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8

from grasptransfer.camera import Camera
from grasptransfer.drawing.studio import (
    GROUND,
    LIGHTING,
    Studio,
    View,
    framed,
    painted,
)
from grasptransfer.drawing.views import look_at
from grasptransfer.files import write_whole, writing
from grasptransfer.frames import rigid, transform_points
from grasptransfer.report.embedded import gif_bytes
from grasptransfer.report.grasp_pictures import HAND, OBJECT, OBSTACLE, REFUSED, USABLE

if TYPE_CHECKING:
    from grasptransfer.grasping import Gripper
    from grasptransfer.simulation import TrialResult
    from grasptransfer.simulation.outcome import Recording

MOVIE = (300, 300)  # px
FIELD_OF_VIEW = 0.5  # rad, before the zoom
AZIMUTHS, ELEVATIONS = np.deg2rad(np.arange(0, 360, 15)), np.deg2rad([15, 30, 50])
MOST_FRAMES = 60
ENTERING = 0.6  # share of the way in that is not framed: the gripper enters the picture
FARTHEST = 0.45  # m from the hand: what was dropped falls out of the picture
TABLE = (0.5, 0.5, 0.01)  # m


def movie(
    trial: "TrialResult",
    mesh: trimesh.Trimesh,
    gripper: "Gripper",
    studio: Studio,
    *,
    moments: Int[np.ndarray, "t"] | None = None,
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Frames of a recorded trial; empty where nothing was recorded.

    Args:
        mesh: what was executed on, object frame [m].
        moments: indices into the recording; None: at most `MOST_FRAMES`, evenly spread.
    """
    recording = trial.recording
    if recording is None:
        return []
    pads = gripper.finger_links
    colour = USABLE if trial.held else REFUSED
    known = recording.world_from_link
    shapes = {k.name: k.visual for k in gripper.links if k.visual is not None and k.name in known}
    parts = [painted(mesh, OBJECT)]
    parts += [painted(shape, colour if name in pads else HAND) for name, shape in shapes.items()]
    if moments is None:
        moments = np.unique(np.linspace(0, len(recording.seconds) - 1, MOST_FRAMES).round().astype(int))
    poses = [recording.world_from_object[moments]]
    poses += [recording.world_from_link[name][moments] for name in shapes]
    holding = [True] + [name in pads for name in shapes]
    approaching = sum(recording.phases[moment] == "approach" for moment in moments)
    shown = slice(min(round(ENTERING * approaching), len(moments) - 1), None)
    corners = _corners(parts, [moves[shown] for moves in poses], holding)
    base = known[gripper.base_link][:, :3, 3].mean(0)
    near = np.linalg.norm(corners - base, axis=1) < FARTHEST
    view = _view(corners[near] if near.any() else corners, _direction(recording, shapes, pads))
    if recording.table_height is not None:
        parts.append(painted(trimesh.creation.box(TABLE), OBSTACLE))
        below = rigid(np.eye(3), np.array([0, 0, recording.table_height - TABLE[2] / 2]))
        poses.append(np.broadcast_to(below, (len(moments), 4, 4)))
    drawn = studio.renderer.animate(
        parts, view.camera, view.camera_from_object, np.stack(poses, 1), ground=GROUND, lighting=LIGHTING
    )
    return [np.array(frame) for frame in drawn]


def seconds_per_frame(trial: "TrialResult") -> float:
    """Real time between the frames of `movie` [s]."""
    recording = trial.recording
    if recording is None or len(recording.seconds) < 2:
        return 0.1
    return float(recording.seconds[-1]) / (min(len(recording.seconds), MOST_FRAMES) - 1)


def save_movies(
    trials: "Sequence[TrialResult]", mesh: trimesh.Trimesh, gripper: "Gripper", folder: str | Path
) -> list[Path]:
    """Write `<grasp>_<trial>.gif` of each recorded trial.

    Args:
        mesh: what was executed on, object frame [m].
        folder: is made where it does not exist.
    """
    from grasptransfer.drawing.rendering import Renderer

    folder, written = Path(folder), []
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Renderer() as renderer:
        for trial in trials:
            frames = movie(trial, mesh, gripper, Studio(renderer))
            if not frames:
                continue
            name = re.sub(r"[^\w.+-]+", "_", trial.grasp).lstrip(".")  # it may hold slashes
            path = folder / f"{name}_{trial.trial}.gif"
            write_whole(path, gif_bytes(frames, seconds_per_frame=seconds_per_frame(trial)))
            written.append(path)
    return written


def _corners(parts, poses, framed_parts: list[bool]) -> Float[np.ndarray, "m 3"]:
    """Corners of the boxes around the object and the fingers at every moment, world frame."""
    boxes = []
    for part, moves, shown in zip(parts, poses, framed_parts, strict=True):
        if shown:
            corners = trimesh.bounds.corners(part.bounds)
            boxes += [transform_points(pose, corners) for pose in moves]
    return np.concatenate(boxes)


def _direction(recording: "Recording", links: Iterable[str], pads: Collection[str]) -> tuple[float, float]:
    """Azimuth and elevation of a camera that sees the fingers side by side, and no back of the hand."""
    first = {name: poses[0, :3, 3] for name, poses in recording.world_from_link.items()}
    tips = [first[name] for name in links if name in pads]
    base = [first[name] for name in links if name not in pads]
    if len(tips) < 2 or not base:
        return 0.6, float(ELEVATIONS[0])
    closing, approach = tips[1] - tips[0], np.mean(tips, axis=0) - base[0]
    across = np.cross(approach, closing)
    across, approach = (vector / max(np.linalg.norm(vector), 1e-9) for vector in (across, approach))

    def clarity(azimuth: float, elevation: float) -> float:
        level = np.cos(elevation)
        to_camera = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        return float(0.8 * abs(to_camera @ across) - 0.9 * abs(to_camera @ approach) - 0.2 * elevation)

    return max(((a, e) for a in AZIMUTHS for e in ELEVATIONS), key=lambda pair: clarity(*pair))


def _view(corners: Float[np.ndarray, "m 3"], direction: tuple[float, float]) -> View:
    width, height = MOVIE
    middle = (corners.min(0) + corners.max(0)) / 2
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    pose = look_at(6 * radius, *direction) @ rigid(np.eye(3), -middle)
    camera = Camera.from_fov(width, height, FIELD_OF_VIEW)
    pixels = camera.project(transform_points(pose, corners))
    box = framed((*pixels.min(0), *pixels.max(0)), width / height, 1.08)
    return View(camera.crop(box, width, height), pose)
