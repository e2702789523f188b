"""`grasptransfer demo | transfer | simulate`: from files to grasps, a report and executed trials."""

from pathlib import Path

from rich.console import Console

from grasptransfer.cli.progress import progress_bar
from grasptransfer.errors import check_seed
from grasptransfer.report.execution_table import SimulationSettings, run_simulation
from grasptransfer.report.transfer_files import TransferSettings, run_transfer

console = Console(markup=False)


def demo(*, out: Path = Path("demo_out"), seed: int = 0) -> int:
    """Transfer grasps to a mug that no training saw, execute them, and write a report.

    Args:
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        seed: seed of everything random.
    """
    from grasptransfer.report.demo import run_demo

    check_seed(seed)
    with progress_bar(console) as progress:
        outcome = run_demo(out, seed=seed, on_stage=lambda text: progress.console.print(f"  {text}"))
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def transfer(settings: TransferSettings) -> int:
    """Transfer the annotated grasps of a category to the instance in a picture."""
    outcome = run_transfer(settings)
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def simulate(settings: SimulationSettings) -> int:
    """Execute grasps on a mesh in a physics engine."""
    table, held = run_simulation(settings)
    console.print(table)
    return 0 if held else 1
