"""Full or read-only disks, no way to draw, killed processes: a clear message, nothing half-written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grasptransfer.category import load_category
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.report.transfer_files import replacing_files

DEMO = load_category("mug").folder / "demo"
# Files above this size cannot be written: as a full disk, for this process alone.
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
sys.argv = ["grasptransfer", *sys.argv[1:]]
from grasptransfer.cli import main
main()
"""


def _transfer(out: Path) -> list[str]:
    files = ["--pose", str(DEMO / "pose.yaml"), "--camera", str(DEMO / "camera.yaml"), "--out", str(out)]
    return ["transfer", str(DEMO / "picture.png"), "--category", "mug", "--estimator", "rigid", *files]


def test_a_full_disk_ends_with_one_line_and_nothing_stays(tmp_path):
    command = [sys.executable, "-c", LIMITED.format(size=50_000), *_transfer(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert "cannot be written. File too large" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_where_nothing_can_be_drawn_a_transfer_says_what_is_missing(tmp_path):
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path), "EGL_PLATFORM": "surfaceless"}
    code = "from grasptransfer.drawing.rendering import Renderer\nRenderer()"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert "GraspTransferError: EGL: cannot draw here" in done.stderr.splitlines()[-1]
    assert "libegl1" in done.stderr.splitlines()[-1]


def test_what_a_killed_process_left_beside_the_folder_goes_and_what_a_living_one_has_stays(tmp_path):
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True
    )
    left = tmp_path / f".out.{gone.stdout.strip()}-abc"
    living, foreign = tmp_path / f".out.{os.getpid()}-abc", tmp_path / ".out.mine-abc"
    for folder in (left, living, foreign):
        folder.mkdir()
        (folder / "half.yaml").touch()
    with replacing_files(tmp_path / "out") as folder:
        (folder / "a.txt").write_text("whole")
    assert not left.exists()
    assert living.exists()
    assert foreign.exists()
    assert (tmp_path / "out" / "a.txt").read_text() == "whole"


def test_a_file_that_cannot_be_written_is_named_where_the_user_wants_it(tmp_path):
    def write_below_a_file():
        with replacing_files(tmp_path / "out") as folder:
            (folder / "here").write_text("a file")
            write_whole(folder / "here" / "below.yaml", b"x")

    with pytest.raises(SettingsError) as caught:
        write_below_a_file()
    assert caught.value.path == tmp_path / "out" / "here" / "below.yaml"
    assert not (tmp_path / "out").exists()


def test_a_read_only_system_is_named():
    # Root may write into any folder, so a kernel's own read-only one is taken.
    command = [sys.executable, "-m", "grasptransfer", *_transfer(Path("/proc/grasps"))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert "/proc/grasps: cannot be written" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
