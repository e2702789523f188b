"""`grasptransfer examples OUT`: the bundled picture with its pose and camera, and the example scripts."""

import filecmp
import shutil
from pathlib import Path

from grasptransfer.category import load_category, objects_folder
from grasptransfer.errors import SettingsError
from grasptransfer.files import writing
from grasptransfer.report.result_files import check_folder

CATEGORY = "mug"
INPUTS = ("picture.png", "pose.yaml", "camera.yaml", "box.yaml")


def examples_folder() -> Path:
    """Folder of the example scripts: inside the installed package, or beside it in a source checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "examples"
    return inside if inside.is_dir() else objects_folder().parent / "examples"


def copy_examples(out: Path) -> list[Path]:
    """Copy the inputs of a transfer and the example scripts into a folder; the paths that were written.

    A file that is there already, and is another one, is somebody's work: nothing is written then.

    Raises:
        SettingsError: the folder cannot be written, or holds other files of these names.
    """
    check_folder(out, "out")
    package = Path(__file__).resolve().parents[1]
    demo, scripts = load_category(CATEGORY).folder / "demo", examples_folder()
    sources = {out / name: demo / name for name in INPUTS}
    for path in sorted(scripts.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            sources[out / path.relative_to(scripts)] = path
    sources[out / "ros2" / "grasptransfer_client.py"] = package / "service" / "client.py"
    for target, source in sources.items():
        if target.exists() and not filecmp.cmp(source, target, shallow=False):
            raise SettingsError(
                "is there already, and is another file", path=target, fix="Give another folder"
            )
    with writing(out):
        for target, source in sources.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    return list(sources)
