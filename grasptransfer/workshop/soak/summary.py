"""All long runs of a folder in one document, from which the pages' table is made."""

import json
from collections import Counter
from pathlib import Path

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import Record
from grasptransfer.workshop.soak import faults, run, watch

NAME = "soak.json"  # the document, in the folder of the runs
KINDS = ("damaged files", "arguments", "kills", "load")


def summarise(folder: Path) -> list[dict]:
    """Rows of `kind`, `subject`, `tried`, `failed` and `lost`, of what has been run.

    Args:
        folder: with the records of the runs.

    Raises:
        SettingsError: there is none in it.
    """
    rows = [*_files(folder), *_arguments(folder), *_kills(folder), *_load(folder)]
    if not rows:
        raise SettingsError("holds no run", path=folder, key="out", fix="make soak")
    return rows


def _row(kind: str, subject: str, tried: int, failed: int, lost: int = 0) -> dict:
    return {"kind": kind, "subject": subject, "tried": tried, "failed": failed, "lost": lost}


def _files(folder: Path) -> list[dict]:
    outcomes: dict[str, Counter] = {}
    for entry in Record(folder / run.RECORD).lines():
        outcomes.setdefault(entry["format"], Counter()).update(entry["outcomes"])
    return [
        _row(KINDS[0], name, found.total(), found.total() - sum(found[good] for good in watch.GOOD))
        for name, found in outcomes.items()
    ]


def _arguments(folder: Path) -> list[dict]:
    rows = _rows_of(folder / "arguments.json")
    return [
        _row(KINDS[1], row["subject"], row["answered"] + row["refused"] + row["failed"], row["failed"])
        for row in rows
    ]


def _kills(folder: Path) -> list[dict]:
    outcomes: dict[str, Counter] = {}
    for line in Record(folder / faults.RECORD).lines():
        outcomes.setdefault(line["job"], Counter()).update([line["outcome"]])
    return [
        _row(
            KINDS[2],
            name,
            found.total(),
            found.total() - found["lost"] - sum(found[good] for good in faults.GOOD),
            found["lost"],
        )
        for name, found in outcomes.items()
    ]


def _load(folder: Path) -> list[dict]:
    return [
        _row(KINDS[3], row["run"], row["transfers"], row["different"])
        for row in _rows_of(folder / "load.json")
    ]


def _rows_of(path: Path) -> list[dict]:
    return json.loads(path.read_text())["rows"] if path.is_file() else []
