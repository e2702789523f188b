"""`grasptransfer pose | board`: the pose of an object in a photograph, and boards that give it."""

from rich.console import Console

from grasptransfer.cli.progress import stages
from grasptransfer.posing.files import (
    BoardSettings,
    PoseFileSettings,
    open_session,
    write_board,
    write_overview,
    write_proposal,
)

console = Console(markup=False, soft_wrap=True, highlight=False)


def pose(settings: PoseFileSettings) -> int:
    """Find the pose of an object in a photograph, correct it in the browser, and write it."""
    with stages() as on_stage:
        session = open_session(settings, on_stage=on_stage)
    if settings.overview is not None:
        write_overview(session, settings.overview)
    if not settings.browser:
        console.print(write_proposal(session, settings))
        return 0
    from grasptransfer.posing.browser import pose_in_browser

    where = {"host": settings.host, "port": settings.port}
    pose_in_browser(session, settings.out, **where, on_ready=console.print)
    return 0


def board(settings: BoardSettings) -> int:
    """Write a marker board to print: laid on the table, it gives `pose --board` the table's pose."""
    description = write_board(settings)
    console.print(f"Print {settings.out} at 100 %, lay it flat, and give {description} to `pose --board`.")
    return 0
