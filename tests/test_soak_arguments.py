"""Whatever a caller gives: an answer with finite numbers, or an error that names the argument."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from grasptransfer.errors import SettingsError
from grasptransfer.options import Seed, check_counts
from grasptransfer.workshop.soak.arguments import ArgumentSettings, try_settings

FEW = ArgumentSettings(examples=60)


@dataclass(frozen=True)
class Careful:
    """Refuses by name what it cannot use."""

    folder: Path
    count: int = 1
    share: float | None = None
    seed: Seed = 0

    def __post_init__(self):
        check_counts(self, "count")
        if self.share is not None and not 0 <= self.share <= 1:
            raise SettingsError("must be between 0 and 1", key="share", value=self.share)


@dataclass(frozen=True)
class Careless:
    """Fails where a count is 0."""

    count: int = 1

    def __post_init__(self):
        _ = 1 // self.count


def test_settings_that_refuse_by_name_pass_and_others_are_found_with_the_smallest_example():
    row = try_settings(Careful, FEW)
    assert (row.failed, row.answered + row.refused) == (0, 60)
    assert min(row.answered, row.refused) > 0
    row = try_settings(Careless, FEW)
    assert row.failed == 1
    assert "ZeroDivisionError" in row.detail
    assert "'count': 0" in row.detail


def test_arguments_of_transfers_and_settings_of_every_command_are_answered_or_refused_by_name(tmp_path):
    # A process of its own: here, the test suite's checks of types would answer in place of the package's own.
    command = [sys.executable, "-m", "grasptransfer.workshop.soak", "arguments", "--examples", "15"]
    done = subprocess.run([*command, "--out", str(tmp_path)], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {row["subject"]: row for row in json.loads((tmp_path / "arguments.json").read_text())["rows"]}
    assert {"transfer_grasps", "TransferSettings", "BuildSettings", "TrainingConfig"} <= rows.keys()
    assert rows["transfer_grasps"]["answered"] > 0 < rows["transfer_grasps"]["refused"]
