"""The command line: every help runs, wrong input ends with code 2 and one clear line."""

import subprocess
import sys

import pytest

from grasptransfer.cli import COMMANDS, GROUPS, main

EVERY_COMMAND = [[name] for name in COMMANDS] + [[group, name] for group in GROUPS for name in GROUPS[group]]


def _run(arguments: list[str], capsys) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    printed = capsys.readouterr()
    return stopped.value.code or 0, printed.out, printed.err


@pytest.mark.parametrize("command", EVERY_COMMAND, ids=" ".join)
def test_every_command_explains_itself(command, capsys):
    code, out, _ = _run([*command, "--help"], capsys)
    assert code == 0
    assert command[-1] in out


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["category", "info", "teapot"], "mug"),
        (["frames", "claw"], "panda"),
        (["bench", "registration", "--json", "x.json", "--categories", "mug", "--views", "99"], "74"),
        (["convert", "no_such.yaml", "out.npy"], "no_such.yaml"),
        (["train", "teapot"], "mug"),
    ],
)
def test_wrong_input_ends_with_code_2_and_names_the_choices(arguments, word, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = _run(arguments, capsys)
    assert code == 2
    assert word in err
    assert "Traceback" not in out + err
    assert list(tmp_path.iterdir()) == []


def test_the_installed_command_runs():
    done = subprocess.run(
        [sys.executable, "-m", "grasptransfer", "--help"], capture_output=True, text=True, check=True
    )
    assert "transfer" in done.stdout
