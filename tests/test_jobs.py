"""Pieces of work in parallel: what dies, hangs or is killed costs nothing but time."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import piecework
import psutil
import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.jobs import LostError, Record, Workers, cores, run, run_fresh


def values(task, pieces, **options):
    return {ended.index: ended.result() for ended in run(task, pieces, **options)}


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_every_piece_is_computed_once_in_any_number_of_processes(workers):
    pieces = [(number,) for number in range(7)]
    assert values(piecework.scaled, pieces, workers=workers, shared=(3,)) == {n: 3 * n for n in range(7)}
    assert values(piecework.square, [], workers=workers) == {}


def test_workers_stay_from_one_run_to_the_next_and_end_with_the_block():
    with Workers(1) as team:
        first, second = (next(iter(team.run(piecework.process_number, [(0,)]))).result() for _ in range(2))
        assert first == second != os.getpid()
        assert psutil.pid_exists(first)
    assert not psutil.pid_exists(first)


def test_a_piece_whose_process_is_killed_is_done_again(tmp_path):
    pieces = [(number,) for number in range(5)]
    assert values(piecework.die_once, pieces, workers=2, shared=(tmp_path,)) == {n: n for n in range(5)}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1", "3"]


@pytest.mark.parametrize(
    ("task", "said", "limit"), [(piecework.die, "exit code -9", None), (piecework.hang, "did not end", 1.0)]
)
def test_a_piece_that_always_ends_or_stops_its_process_is_lost_alone(task, said, limit):
    # A stall of the machine may cost any piece its first attempts.
    found = list(run(task, [(n,) for n in range(3)], workers=2, limit=limit, attempts=3))
    lost = [ended for ended in found if ended.error is not None]
    assert [ended.index for ended in lost] == [1]
    assert {ended.value for ended in found} == {0, None, 2}
    with pytest.raises(LostError, match=said):
        lost[0].result()


def test_an_error_comes_back_as_it_was_raised_with_its_place_in_the_other_process():
    (ended,) = run(piecework.refuse, [(1,)], workers=1)
    with pytest.raises(SettingsError, match="must not be one") as caught:
        ended.result()
    assert caught.value.key == "number"
    assert "piecework.py" in str(caught.value.__cause__)
    with pytest.raises(RuntimeError, match="UnreadableError"):
        run_fresh(piecework.fail_unreadably, 0)


def test_workers_share_the_cores_and_never_exceed_the_callers_limit(monkeypatch):
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    assert cores() == 1
    assert run_fresh(piecework.environment, *names, threads=3) == {names[0]: "1", names[1]: "3"}
    assert run_fresh(piecework.environment, *names) == dict.fromkeys(names, "1")


def test_leaving_the_loop_early_ends_the_workers():
    before = _children()
    for _ in run(piecework.square, [(number,) for number in range(50)], workers=2):
        break
    assert _children() <= before


def _children() -> set[int]:
    return {child.pid for child in psutil.Process().children(recursive=True)}


PATIENCE = 300  # s: nothing here takes so long on any machine.


@dataclass
class Command:
    """A resumable command in a process of its own, and all processes that it ever started."""

    folder: Path
    pieces: int = 12

    def start(self) -> subprocess.Popen:
        path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
        call = f"recorded(pathlib.Path({str(self.folder)!r}), {self.pieces}, 2)"
        # A shell's background job ignores Ctrl-C, and so would all that it starts.
        code = (
            "import pathlib, signal; from piecework import recorded;"
            f"signal.signal(signal.SIGINT, signal.default_int_handler); {call}"
        )
        return subprocess.Popen(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": path}, stderr=subprocess.PIPE
        )

    @property
    def begun(self) -> list[tuple[int, int]]:
        """Number and process of every piece that has begun."""
        paths = (self.folder / "begun").glob("*")
        return [(int(number), int(process)) for number, process in (path.name.split("-") for path in paths)]

    @property
    def workers(self) -> set[int]:
        return {process for _, process in self.begun}

    def result(self) -> bytes:
        return (self.folder / "result.txt").read_bytes()

    def shut_gate(self, first: int) -> None:
        """Let this piece and those after it wait."""
        write_whole(self.folder / "gate", str(first).encode())

    def until_begun(self, pieces: set[int]) -> None:
        until = time.monotonic() + PATIENCE
        while not pieces <= {number for number, _ in self.begun}:
            assert time.monotonic() < until
            time.sleep(0.005)


def gone(processes: set[int]) -> bool:
    """Whether all of them end."""
    alive = [psutil.Process(number) for number in processes if psutil.pid_exists(number)]
    return not psutil.wait_procs(alive, timeout=PATIENCE)[1]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    command = Command(tmp_path_factory.mktemp("undisturbed"))
    assert command.start().wait(timeout=PATIENCE) == 0
    return command.result()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_killed_command_leaves_no_process_and_resumes_to_the_same_bytes(tmp_path, undisturbed, number):
    command = Command(tmp_path / "run")
    for stop in (2, 7):
        command.shut_gate(stop)
        process = command.start()
        command.until_begun({stop, stop + 1})
        children = {child.pid for child in psutil.Process(process.pid).children(recursive=True)}
        process.send_signal(number)
        code = process.wait(timeout=PATIENCE)
        assert code == {signal.SIGTERM: 128 + number}.get(number, -number)
        assert gone(children | command.workers)
    assert not (command.folder / "result.txt").exists()
    (command.folder / "gate").unlink()
    assert command.start().wait(timeout=PATIENCE) == 0
    assert command.result() == undisturbed
    keys = [json.loads(line)["key"] for line in (command.folder / "record.jsonl").read_text().splitlines()]
    assert sorted(keys) == list(range(command.pieces))  # nothing is lost or doubled
    assert gone(command.workers)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_killed_workers_are_replaced_and_the_bytes_stay(tmp_path, undisturbed, number):
    command = Command(tmp_path / "run")
    command.shut_gate(0)
    process = command.start()
    for stop, following in ((0, 6), (6, command.pieces)):
        command.until_begun({stop, stop + 1})
        for child in psutil.Process(process.pid).children():
            child.send_signal(number)
        command.shut_gate(following)
    assert process.wait(timeout=PATIENCE) == 0
    assert command.result() == undisturbed
    assert len(command.workers) >= 4
    assert gone(command.workers)


def test_a_record_leaves_out_half_a_line_and_goes_on_after_it(tmp_path, caplog):
    path = tmp_path / "below" / "record.jsonl"
    with Record(path) as record:
        assert record.lines() == []
        record.add({"key": 1})
    with path.open("a") as file:
        file.write('{"key": 2, "te')
    with Record(path) as record:
        assert record.lines() == [{"key": 1}]
        assert "line 2 is cut off" in caplog.text
        record.add({"key": 3})
        assert record.lines() == [{"key": 1}, {"key": 3}]


def test_what_is_no_record_is_refused(tmp_path):
    path = tmp_path / "record.jsonl"
    path.write_text("a letter\nto somebody\n")
    with pytest.raises(SettingsError, match=r"record\.jsonl.*no record"):
        Record(path).lines()
    path.write_bytes(bytes(range(256)))
    with pytest.raises(SettingsError, match=r"record\.jsonl"):
        Record(path).lines()
    with pytest.raises(SettingsError, match="cannot be written"):
        Record(path / "below").add({})
    nothing = Record(None)
    nothing.add({"key": 1})
    assert nothing.lines() == []
