"""`log.csv` of a member in training: one row of means every few steps."""

import csv
from pathlib import Path

from grasptransfer.files import write_whole

LOG = "log.csv"


def append_row(folder: Path, step: int, seconds: float, terms: dict[str, float]) -> None:
    """Add a row to the folder's log.

    Args:
        seconds: spent so far on all steps.
        terms: means of the losses since the row before.
    """
    path = folder / LOG
    fresh = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.writer(file)
        if fresh:
            writer.writerow(["step", "seconds", *terms])
        writer.writerow([step, f"{seconds:.1f}", *(f"{value:.5g}" for value in terms.values())])


def drop_rows_after(folder: Path, step: int) -> None:
    """Forget what a killed run logged after the checkpoint from which it goes on: those steps come again."""
    path = folder / LOG
    if not path.exists():
        return
    head, *rows = path.read_text().splitlines(keepends=True) or [""]
    kept = [row for row in rows if int(row.split(",")[0]) <= step]
    if kept:
        write_whole(path, "".join([head, *kept]).encode())
    else:
        path.unlink()


def read_rows(folder: Path) -> list[dict[str, str]]:
    """All rows of the folder's log, by the names of the columns."""
    with (folder / LOG).open(newline="") as file:
        return list(csv.DictReader(file))
