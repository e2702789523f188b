"""Run a benchmark under a progress bar, write its JSON and print its figures."""

import os
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from grasptransfer.cli.progress import progress_bar
from grasptransfer.errors import SettingsError

console = Console()


def run(benchmark: Callable[..., dict], json: Path) -> int:
    """Run it, write its document and print its rows and summary; the exit code.

    Args:
        benchmark: takes `progress`, which is told how many of how many are done, and gives the document.
        json: file for the document.

    Raises:
        GraspTransferError: wrong input, named by argument, value and choices.
    """
    from grasptransfer.workshop.benchmark.document import write_document
    from grasptransfer.workshop.benchmark.tables import rows_table

    _check_place(json)
    with progress_bar(console) as progress:
        task = progress.add_task("instances", total=None, visible=False)  # not before the settings are taken

        def tell(done: int, total: int):
            progress.update(task, completed=done, total=total, visible=True)

        result = benchmark(progress=tell)
    write_document(result, json)
    ledger_of(json).unlink(missing_ok=True)
    rows = rows_table(result)
    if rows is not None:
        console.print(rows)
    console.print(_summary_table(result))
    console.print(f"Rows and settings: {json}")
    return 0


def _check_place(json: Path) -> None:
    """Refuse before hours of work what could not be written after them."""
    if json.is_dir():
        raise SettingsError("is a folder", path=json, key="json", fix="Give a file")
    folder = next(above for above in json.absolute().parents if above.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise SettingsError("cannot be written", path=json, key="json", fix=f"Not into {folder}")


def ledger_of(json: Path) -> Path:
    """Finished rows of a run that has not ended."""
    return json.with_name(json.name + ".rows")


def _summary_table(result: dict) -> Table:
    table = Table("measure", "value", title=result["benchmark"])
    for name, value in result["summary"].items():
        table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    return table
