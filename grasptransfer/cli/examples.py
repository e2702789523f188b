"""`grasptransfer examples`: files to begin with."""

from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

console = Console(markup=False)


def examples(out: Positional[Annotated[Path, arg(metavar="OUT")]] = Path("grasptransfer_examples")) -> int:
    """Copy a picture with its pose and camera, and the example scripts, into a folder of yours.

    Args:
        out: folder to copy into.
    """
    from grasptransfer.report.example_files import copy_examples

    written = copy_examples(out)
    scripts = sorted(path.name for path in written if path.suffix == ".py" and path.parent == out)
    transfer = "grasptransfer transfer picture.png --category mug --pose pose.yaml --camera camera.yaml"
    for line in (
        f"{len(written)} files in {out}. Try:",
        f"  cd {out}",
        f"  {transfer} --out result",
        f"  python {scripts[0]}",
    ):
        console.print(line, soft_wrap=True)
    return 0
