"""`python -m grasptransfer.workshop.soak [files | arguments | faults | load | summary] …`: long runs."""

import dataclasses
import logging
import sys
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from grasptransfer.errors import GraspTransferError
from grasptransfer.workshop.benchmark.document import document, write_document
from grasptransfer.workshop.soak.arguments import (
    ArgumentSettings,
    arguments_table,
    settings_of,
    try_settings,
    try_transfers,
)
from grasptransfer.workshop.soak.faults import FaultSettings, faults_table, run_faults
from grasptransfer.workshop.soak.load import LoadSettings, load_table, run_load
from grasptransfer.workshop.soak.run import SoakSettings, run_soak, soak_table
from grasptransfer.workshop.soak.summary import NAME, summarise

CONSOLE = Console()
Out = Annotated[Path, tyro.conf.arg(help="folder for the document with the results.")]


def files(settings: SoakSettings) -> int:
    """Damaged files of every format that is read."""
    with Progress(console=CONSOLE) as bar:
        entries = run_soak(settings, progress=_shown(bar))
    table, bad = soak_table(settings, entries)
    CONSOLE.print(table)
    for entry in entries:
        for failure in entry["failures"][:3]:
            CONSOLE.print(f"{entry['format']}, seed {failure['seed']}: {failure['detail']}", soft_wrap=True)
    return 1 if bad else 0


def arguments(settings: ArgumentSettings, out: Out) -> int:
    """Arguments of transfers, and settings of every command."""
    main = import_module("grasptransfer.cli.main")  # by its name: what is tested lies above the tests
    tables = (main.COMMANDS, *main.GROUPS.values())
    places = [f"grasptransfer.cli.{place}" for table in tables for place in table.values() if ":" in place]
    logging.disable(logging.WARNING)
    warnings.simplefilter("ignore")
    rows = [try_transfers(settings)]
    rows += [try_settings(kind, settings) for kind in settings_of(places)]
    CONSOLE.print(arguments_table(rows))
    failed = [row for row in rows if row.failed]
    for row in failed:
        CONSOLE.print(f"{row.subject}: {row.detail}", soft_wrap=True, markup=False)
    _keep("soak-arguments", settings, [dataclasses.asdict(row) for row in rows], out / "arguments.json")
    return 1 if failed else 0


def faults(settings: FaultSettings) -> int:
    """Commands killed at random moments, and their workers."""
    with Progress(console=CONSOLE) as bar:
        lines = run_faults(settings, progress=_shown(bar))
    table, bad = faults_table(settings, lines)
    CONSOLE.print(table)
    for line in lines:
        if line["detail"]:
            CONSOLE.print(f"{line['job']}, {line['number']}: {line['detail']}", soft_wrap=True, markup=False)
    _keep("soak-faults", settings, lines, settings.out / "faults.json")
    return 1 if bad else 0


def load(settings: LoadSettings, out: Out) -> int:
    """Many transfers in one process, in threads and in processes: memory, speed, the same answers."""
    rows = run_load(settings, progress=CONSOLE.print)
    table, bad = load_table(rows)
    CONSOLE.print(table)
    _keep("soak-load", settings, [dataclasses.asdict(row) for row in rows], out / "load.json")
    return 1 if bad else 0


def summary(out: Out) -> int:
    """All runs of a folder in one document, soak.json, for `grasptransfer.workshop.figures --keep`."""
    rows = summarise(out)
    for row in rows:
        CONSOLE.print(" ".join(f"{name} {value}" for name, value in row.items()), soft_wrap=True)
    write_document(document("soak", settings={}, rows=rows, summary={}), out / NAME)
    return 1 if any(row["failed"] or row["lost"] for row in rows) else 0


def _shown(bar: Progress) -> Callable[[str, int, int], None]:
    task = bar.add_task("", total=None)
    return lambda name, done, total: bar.update(task, description=name, completed=done, total=total)


def _keep(name: str, settings: object, rows: list[dict], path: Path) -> None:
    given = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}  # pyright: ignore
    write_document(document(name, settings=given, rows=rows, summary={}), path)


if __name__ == "__main__":
    logging.basicConfig(level=logging.ERROR)
    words = sys.argv[1:]
    commands = {"files": files, "arguments": arguments, "faults": faults, "load": load, "summary": summary}
    try:
        sys.exit(
            tyro.extras.subcommand_cli_from_dict(
                commands,
                prog="python -m grasptransfer.workshop.soak",
                # Without a name it is the files.
                args=words if words and words[0] in (*commands, "-h", "--help") else ["files", *words],
                config=(tyro.conf.OmitArgPrefixes,),
            )
        )
    except GraspTransferError as error:
        Console(stderr=True).print(f"error: {error}", soft_wrap=True, markup=False)
        sys.exit(2)
