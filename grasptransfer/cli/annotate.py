"""`grasptransfer annotate`: the annotator, served in the browser."""

from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

console = Console(markup=False, soft_wrap=True)


def annotate(
    category: Positional[Annotated[str, arg(metavar="CATEGORY")]],
    *,
    gripper: str = "panda",
    grasps: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> int:
    """Annotate grasps of a category in the browser.

    Args:
        category: name or folder of the category.
        gripper: name of a gripper, or your own YAML file.
        grasps: file to edit; the category's own if none is given.
        host: address to serve at; 0.0.0.0 lets other machines in.
        port: port to serve at.
    """
    from grasptransfer.annotator.browser import annotate as serve

    serve(category, gripper=gripper, path=grasps, host=host, port=port, on_ready=console.print)
    return 0
