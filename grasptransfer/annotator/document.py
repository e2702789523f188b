"""The grasp file behind a session: where it is, what it holds, and how it is changed."""

from collections.abc import Mapping
from pathlib import Path

import grasptransfer
from grasptransfer.annotator.kept_text import changed_text
from grasptransfer.category import Category
from grasptransfer.errors import GraspFileError
from grasptransfer.files import write_whole
from grasptransfer.grasping import Grasp, Gripper, read_grasp_file, save_grasps
from grasptransfer.grasping.grasp_entry import write_entry
from grasptransfer.grasping.grasps import file_block


def own_path(category: Category) -> Path:
    """Where a category's grasps are saved unless another file is named: never in the installed package."""
    installed = Path(grasptransfer.__file__).parent
    if category.folder.resolve().is_relative_to(installed.resolve()):
        return Path.cwd() / f"{category.name}_grasps.yaml"
    return category.grasps_path


class GraspDocument:
    """A grasp file that is edited.

    Args:
        category: whose canonical model the grasps are on.
        gripper: that executes them.
        path: of the file, which may be missing. None takes `own_path`, which starts with the category's
            grasps where it is missing.

    Raises:
        GraspFileError: the file has a mistake, or is for another category or gripper.
    """

    def __init__(self, category: Category, gripper: Gripper, path: Path | None = None):
        self.category, self.gripper = category, gripper
        self.path = own_path(category) if path is None else Path(path)
        self.grasps: dict[str, Grasp] = {}
        self.of_another_model = False
        self._source: Path | None = None
        starts_from = self.path if path is not None or self.path.is_file() else category.grasps_path
        if starts_from.is_file():
            self._read(starts_from)

    def write(self, grasps: Mapping[str, Grasp], renamed: Mapping[str, str]) -> None:
        """Write the file; where there was one, comments, order and style stay, and a copy `.bak` is kept.

        Args:
            grasps: the grasps by name, in order.
            renamed: for each grasp whose name has changed, its name in the file, by its present name.

        Raises:
            SettingsError: the folder cannot be written.
        """
        if self._source is None:
            save_grasps(tuple(grasps.values()), self.path, **self._made_for)
        else:
            changed = changed_text(
                self._source.read_text(encoding="utf-8"),
                block=file_block(**self._made_for),
                grasps={name: self._entry(grasp, renamed) for name, grasp in grasps.items()},
                renamed={name: former for name, former in renamed.items() if name in grasps},
            )
            if self.path.is_file():
                write_whole(self.path.with_name(f"{self.path.name}.bak"), self.path.read_bytes())
            write_whole(self.path, changed.encode())
        self._source, self.grasps = self.path, dict(grasps)

    def _entry(self, grasp: Grasp, renamed: Mapping[str, str]) -> dict | None:
        """The entry of a grasp; None where the file holds it already."""
        before, entry = self.grasps.get(renamed.get(grasp.name, grasp.name)), write_entry(grasp)
        return None if before is not None and write_entry(before) == entry else entry

    @property
    def _made_for(self) -> dict:
        known = self.gripper.path.stem == self.gripper.name
        return {
            "category": self.category.name,
            "gripper": self.gripper.name if known else str(self.gripper.path),
            "canonical_sha256": self.category.canonical_sha256,
        }

    def _read(self, path: Path) -> None:
        file, self._source = read_grasp_file(path), path
        if file.category != self.category.name:
            raise GraspFileError(
                "is for another category",
                path=path,
                key="grasptransfer.category",
                value=file.category,
                choices=[self.category.name],
            )
        if file.gripper not in (self.gripper.name, self.gripper.path.name, str(self.gripper.path)):
            raise GraspFileError(
                f"its grasps are for another gripper than {self.gripper.name}",
                path=path,
                key="grasptransfer.gripper",
                value=file.gripper,
                fix="Name that gripper, or edit another file",
            )
        self.grasps = {grasp.name: grasp for grasp in file.grasps}
        self.of_another_model = file.canonical_sha256 not in (None, self.category.canonical_sha256)
