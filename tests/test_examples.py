"""Every example runs as a user would run it, in a folder of its own, and leaves the files it names."""

import re
import runpy
import sys
from pathlib import Path

import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.report.example_files import copy_examples

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("[0-9]*.py"))

# It wants clouds of one's own; test_category_choices.py runs it on some.
QUICK = [path for path in EXAMPLES if path.stem != "08_settings_from_clouds"]


@pytest.mark.parametrize("path", QUICK, ids=lambda path: path.stem)
def test_an_example_runs_and_writes_what_it_says(path, tmp_path, monkeypatch, capsys):
    copy_examples(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [path.name, "--quick"])
    runpy.run_path(path.name, run_name="__main__")
    printed = capsys.readouterr().out
    assert printed
    for name in re.findall(r"Look at ([\w./]+\.(?:png|html))", printed):
        assert (tmp_path / name).stat().st_size > 2000


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_how_to_use_it(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 100
    assert f"Usage: python examples/{path.name}" in text.split('"""')[1]


def test_copies_never_replace_files_that_somebody_changed(tmp_path):
    written = copy_examples(tmp_path)
    assert {path.name for path in EXAMPLES} | {"picture.png", "pose.yaml"} <= {path.name for path in written}
    assert copy_examples(tmp_path) == written
    (tmp_path / "camera.yaml").write_text("fx: 1")
    (tmp_path / "pose.yaml").unlink()
    with pytest.raises(SettingsError, match=r"camera\.yaml: is there already, and is another file"):
        copy_examples(tmp_path)
    assert not (tmp_path / "pose.yaml").exists()
