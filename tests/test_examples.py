"""Every example runs as a user would run it, in a folder of its own, and leaves the files it names."""

import re
import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("[0-9]*.py"))

# It wants clouds of one's own; test_category_choices.py runs it on some.
QUICK = [path for path in EXAMPLES if path.stem != "08_settings_from_clouds"]


@pytest.mark.parametrize("path", QUICK, ids=lambda path: path.stem)
def test_an_example_runs_and_writes_what_it_says(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), "--quick"])
    runpy.run_path(str(path), run_name="__main__")
    printed = capsys.readouterr().out
    assert printed
    for name in re.findall(r"Look at ([\w./]+\.(?:png|html))", printed):
        assert (tmp_path / name).stat().st_size > 2000


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_how_to_use_it(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 100
    assert f"Usage: python examples/{path.name}" in text.split('"""')[1]
