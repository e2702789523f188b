"""Executed trials in one picture."""

import dataclasses

import numpy as np
import pytest
import trimesh
from PIL import Image

from grasptransfer.errors import SettingsError
from grasptransfer.grasping import load_gripper
from grasptransfer.report.movie import MOVIE
from grasptransfer.report.trial_sheet import ExecutedTrial, _moments, trial_sheet
from grasptransfer.simulation import simulate

PANDA = load_gripper("panda")
BAR = trimesh.creation.box(extents=(0.02, 0.12, 0.05))


@pytest.fixture(scope="module")
def trial():
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.01
    return simulate([above], BAR, PANDA, frames=20)[0]


def test_the_moments_are_those_of_the_phases(trial):
    recording = trial.recording
    moments = _moments(recording, PANDA.base_link)
    assert [recording.phases[moment] for moment in moments] == ["approach", "close", "lift", "turn"]
    height = recording.world_from_link[PANDA.base_link][moments, 2, 3]
    assert height[2] - height[1] == pytest.approx(0.10, abs=0.005)
    before, turned = recording.world_from_link[PANDA.base_link][moments[2:], :3, :3]
    cosine = (np.trace(before.T @ turned) - 1) / 2
    assert np.degrees(np.arccos(cosine)) == pytest.approx(30, abs=3)


def test_a_sheet_has_a_line_for_each_trial(trial, tmp_path):
    one = ExecutedTrial(trial, BAR, "bar: held")
    path = trial_sheet(tmp_path / "trials.png", [one, one], PANDA)
    with Image.open(path) as picture:
        assert picture.width > 4 * MOVIE[0]
        assert picture.height > 2 * MOVIE[1]
        first, lines = np.asarray(picture, int), picture.height
    top, below = first[26 : 26 + MOVIE[1]], first[lines - MOVIE[1] - 26 : lines - 26]
    assert np.abs(top - below).max() <= 8  # the renderer rounds
    # Green fingers in every picture.
    for column in range(4):
        part = top[:, column * (MOVIE[0] + 6) :][:, : MOVIE[0]]
        assert ((part[..., 1] > part[..., 0] + 40) & (part[..., 1] > part[..., 2] + 20)).sum() > 100


def test_a_trial_without_a_recording_cannot_be_drawn(trial, tmp_path):
    bare = ExecutedTrial(dataclasses.replace(trial, recording=None), BAR, "bar")
    with pytest.raises(SettingsError, match="no recorded trial"):
        trial_sheet(tmp_path / "trials.png", [bare], PANDA)
