"""Pieces of work for tests of `grasptransfer.jobs`: functions that other processes can import."""

import os
import signal
import time
from pathlib import Path

from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole
from grasptransfer.jobs import Record, run


def square(number: int) -> int:
    return number * number


def scaled(factor: int, number: int) -> int:
    return factor * number


def die_once(folder: Path, number: int) -> int:
    """Kills its process the first time that it is called with an odd number."""
    mark = folder / str(number)
    if number % 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def hang(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGSTOP)
    return number


def refuse(number: int) -> int:
    if number == 1:
        raise SettingsError("must not be one", key="number", value=number)
    return number


class UnreadableError(Exception):
    """Can be written by pickle, and not read."""

    def __init__(self, one, other):
        super().__init__(one)


def fail_unreadably(_: int):
    raise UnreadableError(1, 2)


def environment(*names: str) -> dict[str, str]:
    return {name: os.environ[name] for name in names}


def process_number(_: int) -> int:
    return os.getpid()


def line(folder: Path, number: int) -> str:
    """A text; leaves a file that says that it began, and waits where a gate is shut for it.

    The file `gate` holds the number of the first piece that has to wait.
    """
    (folder / "begun").mkdir(parents=True, exist_ok=True)
    (folder / "begun" / f"{number}-{os.getpid()}").touch()  # Unlike a whole write, under one name.
    while number >= _first_that_waits(folder / "gate"):
        time.sleep(0.01)
    return f"piece {number}"


def _first_that_waits(gate: Path) -> float:
    try:
        return int(gate.read_text())
    except FileNotFoundError:
        return float("inf")


def recorded(folder: Path, pieces: int, workers: int) -> None:
    """A resumable command: `line` of every piece, recorded one by one, then one file of all."""
    with Record(folder / "record.jsonl") as record:
        found = {line["key"]: line["text"] for line in record.lines()}
        rest = [(folder, number) for number in range(pieces) if number not in found]
        for ended in run(line, rest, workers=workers):
            number = rest[ended.index][1]
            found[number] = ended.result()
            record.add({"key": number, "text": found[number]})
    write_whole(folder / "result.txt", "\n".join(found[number] for number in range(pieces)).encode())
