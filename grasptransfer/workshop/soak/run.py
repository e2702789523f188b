"""A run over all formats: its record, from which it goes on, and its table."""

import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from grasptransfer.errors import SettingsError
from grasptransfer.workshop.soak.samples import Format, formats
from grasptransfer.workshop.soak.watch import GOOD, Watched, damaged_file

CHUNK = 100  # files between two entries of the record
RECORD, FAILURES = "files.jsonl", "failures"


@dataclass(frozen=True)
class SoakSettings:
    """What is tried.

    Args:
        out: folder for the record and for the files that failed; a run goes on from the record in it.
        files: damaged files of each format.
        formats: names; none given: all.
        first_seed: first seed of the damages; other seeds damage otherwise.
    """

    out: Path
    files: int = 20_000
    formats: tuple[str, ...] = ()
    first_seed: int = 0

    def __post_init__(self):
        if self.files < 1:
            raise SettingsError("must be at least 1", key="files", value=self.files)
        known = [kind.name for kind in formats()]
        for name in self.formats:
            if name not in known:
                raise SettingsError("is no format that is read", key="formats", value=name, choices=known)

    def chosen(self) -> list[Format]:
        """The formats that are tried."""
        return [kind for kind in formats() if not self.formats or kind.name in self.formats]


def run_soak(
    settings: SoakSettings, *, progress: Callable[[str, int, int], None] = lambda name, done, total: None
) -> list[dict]:
    """Read damaged files of every format; the entries of the record.

    Args:
        progress: called with (format, files of it done, in all).
    """
    settings.out.mkdir(parents=True, exist_ok=True)
    record = settings.out / RECORD
    entries = _read_record(record)
    if record.is_file() and not record.read_text().endswith("\n"):
        with record.open("a") as file:  # The last line was cut off; what follows starts a line of its own.
            file.write("\n")
    done = {(entry["format"], entry["first"]) for entry in entries}
    last = settings.first_seed + settings.files
    for kind in settings.chosen():
        with Watched(kind.name) as watched:
            for first in range(settings.first_seed, last, CHUNK):
                count = min(CHUNK, last - first)
                if (kind.name, first) not in done:
                    entry = _try_chunk(kind, watched, range(first, first + count), settings.out)
                    entries.append(entry)
                    with record.open("a") as file:
                        file.write(json.dumps(entry) + "\n")
                progress(kind.name, first + count - settings.first_seed, settings.files)
    return entries


def soak_table(settings: SoakSettings, entries: Sequence[dict]) -> tuple[Table, int]:
    """What was tried and what became of it, a row for each format; and how many failed or were lost."""
    table = Table("format", *("tried", "refused", "read right", "failed", "lost"), "failures")
    bad = 0
    for kind in settings.chosen():
        of_kind = [entry for entry in entries if entry["format"] == kind.name]
        outcomes: Counter[str] = sum((Counter(entry["outcomes"]) for entry in of_kind), Counter())
        tried = sum(outcomes.values())
        failures = {name: count for name, count in outcomes.items() if name not in GOOD}
        lost = settings.files - tried
        bad += sum(failures.values()) + max(lost, 0)
        words = ", ".join(f"{count} {name}" for name, count in sorted(failures.items()))
        numbers = (tried, outcomes["refused"], outcomes["right"], sum(failures.values()), lost)
        table.add_row(kind.name, *(str(number) for number in numbers), words)
    return table, bad


def _try_chunk(kind: Format, watched: Watched, seeds: range, out: Path) -> dict:
    outcomes, failures = Counter(), []
    for seed in seeds:
        found = watched.attempt(seed)
        outcomes[found.outcome] += 1
        if found.outcome not in GOOD:
            failures.append({"seed": seed, "outcome": found.outcome, "detail": found.detail})
            _keep(kind, seed, out / FAILURES)
    return {"format": kind.name, "first": seeds[0], "outcomes": dict(outcomes), "failures": failures}


def _keep(kind: Format, seed: int, folder: Path) -> None:
    """Keep the file that failed, so that its reader can be mended."""
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        path = damaged_file(kind, seed, Path(name))
        shutil.copy(path, folder / f"{kind.name.replace(' ', '_')}-{seed}{path.suffix}")


def _read_record(path: Path) -> list[dict]:
    """Entries of an earlier run; a line that was cut off by its end is left out."""
    entries = []
    for line in path.read_text().splitlines() if path.is_file() else ():
        try:
            entries.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return entries
