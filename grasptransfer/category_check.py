"""Everything that can be wrong with a category folder, its grasps too, explained."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasptransfer.category.category import (
    CANONICAL,
    FIELDS,
    GRASPS,
    SHAPE_SPACE,
    Category,
    category_folder,
    load_category,
)
from grasptransfer.category.settings import FILE_NAME
from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GraspFileError, GraspTransferError
from grasptransfer.grasping import load_grasps
from grasptransfer.meshes import LARGEST, SMALLEST

CENTRE_TOLERANCE = 2e-3  # m: scans are centred by hand to about a millimetre
FAR = 0.05  # of the canonical's size: control points lie on its surface, less half a voxel


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Args:
        path: the file at fault.
        problem: one sentence.
        fix: what to do about it.
    """

    path: Path
    problem: str
    fix: str = ""

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}" + (f". {self.fix}" if self.fix else "")


def check_category(name_or_folder: str | Path | Category) -> list[Fault]:
    """Every fault of a category; an empty list is a sound one.

    Raises:
        CategoryError: it is neither a known category nor a folder.
    """
    if isinstance(name_or_folder, Category):
        category = name_or_folder
    else:
        folder = category_folder(name_or_folder)
        try:
            category = load_category(folder)
        except GraspTransferError as error:
            return [_fault(folder / FILE_NAME, error)]
    faults = [*_file_faults(category)]
    faults += [*_mesh_faults(category), *_space_faults(category), *_grasp_faults(category)]
    if category.grasps_path.is_file() and category.grasps_path not in [fault.path for fault in faults]:
        faults += _faults_of_each_grasp(category.grasps_path)
    return list(dict.fromkeys(faults))


def _faults_of_each_grasp(path: Path) -> Iterator[Fault]:
    try:
        load_grasps(path)
    except GraspTransferError as error:
        yield _fault(path, error)


def _fault(path: Path, error: GraspTransferError) -> Fault:
    text = str(error).removeprefix(f"{error.path}: ").removesuffix(f". {error.fix}")
    return Fault(Path(error.path or path), text, error.fix or "")


def _file_faults(category: Category) -> Iterator[Fault]:
    needed = [CANONICAL, SHAPE_SPACE, FIELDS]
    needed += [f"instances/{name}.glb" for name in (*category.train, *category.test)]
    for relative in dict.fromkeys([*needed, *category.file.checksums]):
        try:
            category.checked_path(relative)
        except GraspTransferError as error:
            yield _fault(category.folder / relative, error)
    for path in sorted((category.folder / "instances").glob("*")):
        if f"instances/{path.name}" not in category.file.checksums and not path.name.startswith("."):
            yield Fault(
                path, f"belongs to no instance of {FILE_NAME}", "Remove it or build the category again"
            )


def _mesh_faults(category: Category) -> Iterator[Fault]:
    paths = {CANONICAL: lambda: category.canonical}
    for name in (*category.train, *category.test):
        paths[f"instances/{name}.glb"] = lambda name=name: category.instance_mesh(name)
    for relative, load in paths.items():
        path = category.folder / relative
        try:
            mesh = load()
        except GraspTransferError as error:
            yield _fault(path, error)
            continue
        vertices = np.asarray(mesh.vertices)
        if len(vertices) == 0 or not np.isfinite(vertices).all():
            yield Fault(path, "has no vertices, or some that are not finite")
            continue
        low, high = vertices.min(0), vertices.max(0)
        size = float((high - low).max())
        if not SMALLEST <= size <= LARGEST:
            unit = " (millimetres?)" if size > LARGEST else ""
            yield Fault(path, f"its longest side is {size:g} m{unit}", "Scale it to metres")
        elif np.abs(low + high).max() / 2 > CENTRE_TOLERANCE:
            shift = np.round((low + high) / 2, 4).tolist()
            yield Fault(path, f"its bounding box is centred at {shift} m, not at the origin", "Move it there")


def _space_faults(category: Category) -> Iterator[Fault]:
    path = category.folder / SHAPE_SPACE
    try:
        space = category.shape_space
        points = np.asarray(space.control_points)
        modes = len(space.basis)
        mesh = category.canonical
    except GraspTransferError as error:
        yield _fault(path, error)
        return
    settings = category.settings
    for key, told, found in (
        ("control_points", settings.control_points, len(points)),
        ("modes", settings.modes, modes),
        ("beta", settings.beta, space.beta),
    ):
        if told != found:
            yield Fault(category.folder / FILE_NAME, f"settings.{key} is {told}, {SHAPE_SPACE} has {found}")
    size = float(np.linalg.norm(mesh.extents))
    outside = max((mesh.bounds[0] - points).max(), (points - mesh.bounds[1]).max())
    if outside > FAR * size:
        yield Fault(path, f"control points lie {1000 * outside:.0f} mm outside {CANONICAL}", "Build it again")
    for name in (*category.train, *category.test):
        try:
            warped = category.field(name)(points)
        except GraspTransferError as error:
            yield _fault(category.folder / FIELDS, error)
            continue
        if not np.isfinite(warped).all():
            yield Fault(category.folder / FIELDS, f"the field of {name} is not finite", "Build it again")


def _grasp_faults(category: Category) -> Iterator[Fault]:
    path = category.grasps_path
    if not path.is_file():
        yield Fault(path, "there are no grasps yet", f"Annotate some: grasptransfer annotate {category.name}")
        return
    try:
        block = read_yaml(path, error=GraspFileError).get("grasptransfer")
    except GraspFileError as error:
        yield _fault(path, error)
        return
    if isinstance(block, dict) and block.get("category") != category.name:
        yield Fault(path, f"{GRASPS} is for category {block.get('category')!r}, not {category.name!r}")
    told = block.get("canonical_sha256") if isinstance(block, dict) else None
    if told is not None and told != category.file.checksums.get(CANONICAL):
        yield Fault(
            path,
            f"{GRASPS} was annotated on another canonical model",
            "Look at each grasp in the annotator, then save them",
        )
