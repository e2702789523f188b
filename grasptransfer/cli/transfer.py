"""`grasptransfer demo | transfer | simulate`: from files to grasps, a report and executed trials."""

from pathlib import Path

from rich.console import Console

from grasptransfer.cli.json_output import JsonFlag, print_json
from grasptransfer.cli.progress import stages
from grasptransfer.errors import check_seed
from grasptransfer.report.batch import RESULTS, run_batch
from grasptransfer.report.execution_table import SimulationSettings, execution_table, run_simulation
from grasptransfer.report.result_files import as_data
from grasptransfer.report.transfer_files import TransferOutcome, run_transfer
from grasptransfer.report.transfer_inputs import TransferSettings

console = Console(markup=False)


def demo(*, out: Path = Path("demo_out"), seed: int = 0) -> int:
    """Transfer grasps to a mug that no training saw, execute them, and write a report.

    Args:
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        seed: seed of everything random.
    """
    from grasptransfer.report.demo import run_demo

    check_seed(seed)
    with stages() as on_stage:
        outcome = run_demo(out, seed=seed, on_stage=on_stage)
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def transfer(settings: TransferSettings, *, as_json: JsonFlag = False) -> int:
    """Transfer the annotated grasps of a category to the instance in pictures, or in each of a folder.

    Several pictures show one object from several sides. Of a folder, one wrong picture does not stop the
    others; started again, the command resumes.

    Args:
        as_json: print the result as JSON on standard output; of a folder, one line for each picture.
    """
    if len(settings.image) == 1 and settings.image[0].is_dir():
        return _transfer_folder(settings, as_json)
    with stages() as on_stage:
        outcome = run_transfer(settings, on_stage=on_stage)
    if as_json:
        print_json(_as_json(outcome))
    else:
        console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def _transfer_folder(settings: TransferSettings, as_json: bool) -> int:
    with stages() as on_stage:
        on_line = (lambda line: print_json(line, indent=None)) if as_json else (lambda line: None)
        batch = run_batch(settings, on_stage=on_stage, on_line=on_line)
    if not as_json:
        console.print(batch.table())
        for sentence in batch.refused:
            console.print(f"refused: {sentence}", soft_wrap=True)
        again = f"; {batch.again} were done before" if batch.again else ""
        console.print(f"One line for each picture: {settings.out / RESULTS}{again}", soft_wrap=True)
    return 0 if batch.usable else 1


def _as_json(outcome: TransferOutcome) -> dict:
    data = as_data(outcome.result)
    files: dict[str, object] = {"folder": str(outcome.folder)}
    if outcome.trials:
        files["trials"] = [trial.as_data() for trial in outcome.trials]
    return data | files


def simulate(settings: SimulationSettings, *, as_json: JsonFlag = False) -> int:
    """Execute grasps on a mesh in a physics engine."""
    trials = run_simulation(settings)
    if as_json:
        print_json([trial.as_data() for trial in trials])
    else:
        console.print(execution_table(trials))
    return 0 if any(trial.held for trial in trials) else 1
