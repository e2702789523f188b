"""`grasptransfer category build`: a category from meshes."""

from rich.console import Console

from grasptransfer.cli.progress import progress_bar
from grasptransfer.workshop.building import BuildSettings, build_category
from grasptransfer.workshop.building.category_page import category_page

PAGE = "category.html"
console = Console(markup=False)


def build(settings: BuildSettings) -> int:
    """Build a category from your own meshes or point clouds; started again, it resumes."""
    with progress_bar() as progress:
        task = progress.add_task("checking", total=None)
        built = build_category(
            settings,
            progress=lambda state: progress.update(
                task, description=state.step, completed=state.done, total=state.total
            ),
            finish=lambda built: category_page(built, built.category.folder / PAGE),
        )
    folder = built.category.folder
    console.print(
        f"Category: {folder}, in {built.seconds:.0f} s\nEvery registration and the modes: {folder / PAGE}",
        soft_wrap=True,
    )
    return 0
