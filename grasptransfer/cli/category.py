"""`grasptransfer category …`: list, describe, check and build categories."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from rich.console import Console
from rich.table import Table
from tyro.conf import Positional, arg

from grasptransfer.cli.progress import progress_bar
from grasptransfer.errors import GraspTransferError

PAGE = "category.html"
console = Console(markup=False)


def list_() -> int:
    """List the shipped categories."""
    from grasptransfer.category import list_categories, load_category

    table = Table("category", "train", "test", "modes", "beta", "grasps")
    for name in list_categories():
        category = load_category(name)
        settings = category.settings
        row = (len(category.train), len(category.test), settings.modes, f"{settings.beta:g}")
        table.add_row(name, *(str(value) for value in row), "yes" if category.grasps_path.is_file() else "no")
    console.print(table)
    return 0


def info(category: Positional[Annotated[str, arg(metavar="CATEGORY")]]) -> int:
    """Describe a category: settings, split, measured figures.

    Args:
        category: name or folder.
    """
    from grasptransfer.category import load_category

    loaded = load_category(category)
    console.print(loaded.file.model_dump(exclude={"checksums"}, by_alias=True))
    return 0


def check(category: Positional[Annotated[str, arg(metavar="CATEGORY")]]) -> int:
    """Verify a category folder and explain every fault.

    Args:
        category: name or folder.
    """
    from grasptransfer.category import check_category
    from grasptransfer.category.category import GRASPS, category_folder
    from grasptransfer.grasping import load_grasps

    folder = category_folder(category)
    found = check_category(folder)
    faults = [str(fault) for fault in found]
    if (folder / GRASPS).is_file() and folder / GRASPS not in [fault.path for fault in found]:
        try:
            load_grasps(folder / GRASPS)
        except GraspTransferError as error:
            faults.append(str(error))
    for fault in faults:
        console.print(f"fault: {fault}", soft_wrap=True)
    console.print("no fault" if not faults else f"{len(faults)} fault{'s' * (len(faults) > 1)}")
    return 2 if faults else 0


def build(
    name: Positional[Annotated[str, arg(metavar="NAME")]],
    *,
    meshes: Path,
    canonical: str | None = None,
    test: tuple[str, ...] = (),
    out: Path | None = None,
    front: str = "+x",
    up: str = "+z",
    scale: float = 1.0,
    workers: int = 2,
    overwrite: bool = False,
) -> int:
    """Build a category from your own meshes or point clouds; started again, it resumes.

    Args:
        name: of the category.
        meshes: folder of NAME.obj or NAME/mesh.obj (glb gltf obj ply stl off pcd xyz).
        canonical: instance to take as the canonical model, a name or file; default: the best scored.
        test: instances to keep out of the shape space.
        out: folder to write; default: NAME here.
        front: axis of the files that is the front.
        up: axis of the files that points up.
        scale: metres in one unit of the files.
        workers: processes.
        overwrite: replace an existing folder, keeping its grasps.
    """
    from grasptransfer.workshop.building import build_category
    from grasptransfer.workshop.building.category_page import category_page

    with progress_bar(console) as progress:
        task = progress.add_task("checking", total=None)
        built = build_category(
            name,
            meshes=meshes,
            canonical=Path(canonical).stem if canonical else None,
            test=test,
            out=out,
            front=front,
            up=up,
            scale=scale,
            workers=workers,
            overwrite=overwrite,
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


COMMANDS: dict[str, Callable[..., Any]] = {"list": list_, "info": info, "check": check, "build": build}
