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
    console.print(f"{len(written)} files in {out}. Try:\n", soft_wrap=True)
    console.print(f"  cd {out}", soft_wrap=True)
    console.print(
        "  grasptransfer transfer picture.png --category mug --pose pose.yaml --camera camera.yaml --out result",
        soft_wrap=True,
    )
    console.print(f"  python {scripts[0]}", soft_wrap=True)
    return 0
