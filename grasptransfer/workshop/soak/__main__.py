"""`python -m grasptransfer.workshop.soak --out FOLDER`: the long run, resumable."""

import sys

import tyro
from rich.console import Console
from rich.progress import Progress

from grasptransfer.errors import GraspTransferError
from grasptransfer.workshop.soak.run import SoakSettings, run_soak, soak_table


def main() -> int:
    """Run it, print its table; 1 where something failed or was lost."""
    console = Console()
    settings = tyro.cli(SoakSettings, prog="python -m grasptransfer.workshop.soak")
    with Progress(console=console) as bar:
        task = bar.add_task("", total=None)
        entries = run_soak(
            settings,
            progress=lambda name, done, total: bar.update(
                task, description=name, completed=done, total=total
            ),
        )
    table, bad = soak_table(settings, entries)
    console.print(table)
    for entry in entries:
        for failure in entry["failures"][:3]:
            console.print(f"{entry['format']}, seed {failure['seed']}: {failure['detail']}", soft_wrap=True)
    return 1 if bad else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except GraspTransferError as error:
        Console(stderr=True).print(f"error: {error}", soft_wrap=True, markup=False)
        sys.exit(2)
