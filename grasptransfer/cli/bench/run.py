"""Run a benchmark under a progress bar, write its JSON and print its figures."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from grasptransfer.cli.progress import progress_bar
from grasptransfer.errors import SettingsError
from grasptransfer.options import Workers, check_counts

console = Console()


@dataclass(frozen=True)
class Results:
    """Where the results go.

    Args:
        json: file for the results.

    Raises:
        SettingsError: the file could not be written; better now than after hours of work.
    """

    json: Path

    def __post_init__(self):
        if self.json.is_dir():
            raise SettingsError("is a folder", path=self.json, key="json", fix="Give a file")
        folder = next(above for above in self.json.absolute().parents if above.exists())
        if not folder.is_dir() or not os.access(folder, os.W_OK):
            raise SettingsError("cannot be written", path=self.json, key="json", fix=f"Not into {folder}")

    @property
    def ledger(self) -> Path:
        """Finished rows of a run that has not ended."""
        return self.json.with_name(self.json.name + ".rows")


@dataclass(frozen=True)
class ResumedResults(Results):
    """Where the results go, and how many processes measure them.

    Args:
        json: file for the results; a killed run goes on from the file beside it.
    """

    workers: Workers = 2

    def __post_init__(self):
        super().__post_init__()
        check_counts(self, "workers")

    def how(self) -> dict[str, Any]:
        """The arguments that a benchmark takes so that it can resume."""
        return {"workers": self.workers, "ledger": self.ledger}


def run(benchmark: Callable[..., dict], results: Results) -> int:
    """Run a benchmark, write its document, print its rows and summary, and return the exit code.

    Args:
        benchmark: takes `progress`, which it calls with (instances done, in all), and returns the document.
        results: where the document goes.

    Raises:
        GraspTransferError: wrong input, named by argument, value and choices.
    """
    from grasptransfer.workshop.benchmark.document import write_document
    from grasptransfer.workshop.benchmark.tables import rows_table

    with progress_bar() as progress:
        # The bar stays hidden until the benchmark has accepted its settings.
        task = progress.add_task("instances", total=None, visible=False)

        def show(done: int, total: int):
            progress.update(task, completed=done, total=total, visible=True)

        result = benchmark(progress=show)
    write_document(result, results.json)
    results.ledger.unlink(missing_ok=True)
    rows = rows_table(result)
    if rows is not None:
        console.print(rows)
    console.print(_summary_table(result))
    console.print(f"Rows and settings: {results.json}")
    return 0


def _summary_table(result: dict) -> Table:
    table = Table("measure", "value", title=result["benchmark"])
    for name, value in result["summary"].items():
        if isinstance(value, list):  # A table of its own, for the page of figures.
            continue
        table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    return table
