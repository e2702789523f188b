"""`grasptransfer category build`: a category from meshes."""

from rich.console import Console

from grasptransfer.cli.progress import duration, progress_bar
from grasptransfer.jobs import cores
from grasptransfer.workshop.building import BuildSettings, build_category
from grasptransfer.workshop.building.category_page import category_page
from grasptransfer.workshop.building.kept_tasks import BuildProgress

PAGE = "category.html"
# Of one core: examples/02_build_your_own_category.py, five meshes and four pairs of beta and lambda in 30 s.
SECONDS_PER_KERNEL = 1.5
console = Console(markup=False)


def build(settings: BuildSettings) -> int:
    """Build a category from your own meshes or point clouds; started again, it resumes."""
    with progress_bar() as progress:
        task = progress.add_task("checking", total=None)
        said = False

        def show(state: BuildProgress) -> None:
            nonlocal said
            if not said:
                progress.console.print(_expected(settings, state.total), soft_wrap=True)
                said = True
            progress.update(task, description=state.step, completed=state.done, total=state.total)

        built = build_category(
            settings,
            progress=show,
            finish=lambda built: category_page(built, built.category.folder / PAGE),
        )
    folder = built.category.folder
    console.print(
        f"Category: {folder}, in {built.seconds:.0f} s\nEvery registration and the modes: {folder / PAGE}",
        soft_wrap=True,
    )
    return 0


def _expected(settings: BuildSettings, meshes: int) -> str:
    """How long a build takes; one that was stopped has less before it."""
    at_once = min(settings.workers, cores(), meshes)
    seconds = SECONDS_PER_KERNEL * meshes * len(settings.kernels()) / at_once
    return f"{meshes} meshes: about {duration(seconds)}. Ctrl-C stops; the same command goes on"
