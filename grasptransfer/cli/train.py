"""`grasptransfer train`: render pictures, train networks, fit their confidence, write their card."""

from typing import TYPE_CHECKING

from rich.console import Console

from grasptransfer.cli.progress import duration, progress_bar
from grasptransfer.jobs import cores
from grasptransfer.workshop.training.settings import TrainingConfig, TrainingPlace

if TYPE_CHECKING:
    from grasptransfer.workshop.training.training import TrainingProgress

# Of one core: the card of the shipped networks, 2 x 10,000 steps of 32 in 4.07 h on two cores.
SAMPLES_PER_SECOND = 22
console = Console(markup=False)


def train(config: TrainingConfig, place: TrainingPlace) -> int:
    """Render training pictures and train networks; the same command resumes a run that was stopped.

    With more steps or members, the command prolongs a finished run.
    """
    from grasptransfer.workshop.training.train import train as run

    console.print(_expected(config), soft_wrap=True)
    with progress_bar() as progress:
        rendering = progress.add_task("rendering", total=None)
        training = progress.add_task("training", total=config.members * config.steps)
        fitting = progress.add_task("fitting confidence", total=None)
        trained = run(
            config,
            place,
            on_render=lambda done, total: progress.update(rendering, completed=done, total=total),
            on_step=lambda state: progress.update(
                training, completed=state.step, description=_training_line(state)
            ),
            on_confidence=lambda done, total: progress.update(fitting, completed=done, total=total),
        )
    if trained.card is not None:
        console.print(
            f"Weights: {trained.weights}\nModel card: {trained.card}\n{trained.scores}", soft_wrap=True
        )
    return 0


def _expected(config: TrainingConfig) -> str:
    """How much there is to do, and how long it takes; a run that was stopped has less before it."""
    seconds = config.members * config.steps * config.batch / (SAMPLES_PER_SECOND * cores())
    steps = f"{config.members} x {config.steps} steps of {config.batch}"
    return (
        f"{config.samples} pictures to render, then {steps}: about {duration(seconds)} of training here "
        f"(cores: {cores()}). Ctrl-C stops; the same command goes on"
    )


def _training_line(state: "TrainingProgress") -> str:
    terms = "  ".join(f"{name} {value:.3g}" for name, value in state.terms.items())
    return f"training  {state.samples_per_second:.0f}/s  {terms}"
