"""One category on disk, loaded piece by piece when first used."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.category.settings import FILE_NAME, CategoryFile, Settings
from grasptransfer.errors import CategoryError
from grasptransfer.files import sha256
from grasptransfer.meshes import read_scene

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.registration import DeformationField, DisplacementModel, ShapeSpace

CANONICAL = "canonical.glb"
SHAPE_SPACE = "shape_space.npz"
FIELDS = "fields.npz"
FIELDS_KIND = "category fields"
GRASPS = "grasps.yaml"
PREVIEW = "preview.png"


@dataclass(frozen=True)
class Category:
    """A category: everything in metres and in its canonical frame (z up, +x front, bounding box centred).

    Each file is read when first asked for, and its checksum compared.

    Args:
        name: name in `category.yaml`.
        folder: that holds it.
        file: the contents of `category.yaml`.
    """

    name: str
    folder: Path
    file: CategoryFile

    @property
    def settings(self) -> Settings:
        """How the shape space was made."""
        return self.file.settings

    @property
    def density(self) -> float:
        """Of what an instance is made of [kg/m3], of the solid that its mesh encloses."""
        return self.file.density

    @property
    def train(self) -> tuple[str, ...]:
        """Names of the instances behind the shape space."""
        return self.file.split.train

    @property
    def test(self) -> tuple[str, ...]:
        """Names of the instances that nothing was fitted to."""
        return self.file.split.test

    @property
    def canonical_sha256(self) -> str:
        """Checksum of `canonical.glb`, which grasp files and weights refer to."""
        return self._checksum(CANONICAL)

    @property
    def grasps_path(self) -> Path:
        """Where the annotated grasps are, or would be."""
        return self.folder / GRASPS

    def annotated_path(self) -> Path:
        """Where the annotated grasps are.

        Raises:
            CategoryError: nobody has annotated any.
        """
        if not self.grasps_path.is_file():
            fix = f"Annotate some: grasptransfer annotate {self.name}"
            raise CategoryError("has no annotated grasps", path=self.grasps_path, fix=fix)
        return self.grasps_path

    @cached_property
    def canonical(self) -> "trimesh.Trimesh":
        """The canonical model as one textured mesh [m]. Copy it before changing it."""
        return _as_mesh(self.canonical_scene)

    @cached_property
    def canonical_scene(self) -> "trimesh.Scene":
        """The canonical model with its parts and materials apart, for drawing [m]."""
        return load_scene(self.checked_path(CANONICAL))

    def instance_mesh(self, name: str) -> "trimesh.Trimesh":
        """An instance as one textured mesh, object frame [m].

        Raises:
            CategoryError: there is no instance of that name, or its file is missing or corrupt.
        """
        return _as_mesh(self.instance_scene(name))

    def instance_scene(self, name: str) -> "trimesh.Scene":
        """An instance with its parts and materials apart, object frame [m].

        Raises:
            CategoryError: there is no instance of that name, or its file is missing or corrupt.
        """
        if name not in (*self.train, *self.test):
            choices = (*self.train, *self.test)
            raise CategoryError("is not an instance", path=self.folder, key=name, choices=choices)
        return load_scene(self.checked_path(f"instances/{name}.glb"))

    @cached_property
    def shape_space(self) -> "ShapeSpace":
        """The learned shape space."""
        from grasptransfer.registration import ShapeSpace

        return ShapeSpace.load(self.checked_path(SHAPE_SPACE))

    @cached_property
    def vertices_by_latent(self) -> "DisplacementModel":
        """How the latent displaces the canonical model's vertices."""
        return self.shape_space.displacement_model(np.asarray(self.canonical.vertices))

    @cached_property
    def _fields(self) -> dict[str, Float[np.ndarray, "n 3"]]:
        from grasptransfer.registration.storage import load_arrays

        path = self.checked_path(FIELDS)
        data = load_arrays(path, FIELDS_KIND)
        weights, names = data["weights"].astype(float), [str(name) for name in data["names"]]
        shape = self.shape_space.control_points.shape
        if weights.shape != (len(names), *shape):
            raise CategoryError("weights do not fit the shape space", path=path, value=weights.shape)
        return dict(zip(names, weights, strict=True))

    def field(self, name: str) -> "DeformationField":
        """The field from the canonical model to an instance, as it was registered offline.

        Raises:
            CategoryError: there is no instance of that name.
        """
        from grasptransfer.registration import DeformationField

        if name not in self._fields:
            raise CategoryError("has no field", path=self.folder / FIELDS, key=name, choices=self._fields)
        space = self.shape_space
        return DeformationField(
            space.control_points, self._fields[name], space.beta, space.centre, space.scale
        )

    def training_field(self, index: int) -> "DeformationField":
        """The field from the canonical model to train instance number `index`, in the order of `train`."""
        return self.field(self.train[index])

    def checked_path(self, relative: str) -> Path:
        """A file of the folder, once its checksum was found right.

        Raises:
            CategoryError: it is missing, or differs from what `category.yaml` vouches for.
        """
        path = self.folder / relative
        if not path.is_file():
            raise CategoryError("is missing", path=path, fix="Restore the file or build the category again")
        try:
            found = sha256(path)
        except OSError as cause:
            raise CategoryError("cannot be read", path=path, fix=str(cause)) from cause
        if found != self._checksum(relative):
            raise CategoryError(
                f"is corrupt: its checksum is not the one in {FILE_NAME}",
                path=path,
                fix="Restore the file or build the category again",
            )
        return path

    def _checksum(self, relative: str) -> str:
        if relative not in self.file.checksums:
            raise CategoryError("has no checksum", path=self.folder / FILE_NAME, key=f"checksums.{relative}")
        return self.file.checksums[relative]


def objects_folder() -> Path:
    """Folder of the shipped categories: inside the installed package, or beside it in a source checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "objects"
    return inside if inside.is_dir() else package.parent / "objects"


def list_categories() -> tuple[str, ...]:
    """Names of the shipped categories."""
    return tuple(sorted(folder.name for folder in _folders()))


def load_category(name_or_folder: "str | Path | Category") -> Category:
    """A shipped category by its name, or any category by its folder.

    Raises:
        CategoryError: neither a known name nor a category folder; the error lists the known names.
    """
    if isinstance(name_or_folder, Category):
        return name_or_folder
    folder = category_folder(name_or_folder)
    file = CategoryFile.load(folder)
    return Category(file.name, folder, file)


def category_folder(name_or_folder: str | Path) -> Path:
    """Folder of a category: a shipped one by its name, which comes before a folder so called here.

    Raises:
        CategoryError: neither a known name nor a folder; the error lists the known names.
    """
    text = str(name_or_folder)
    if isinstance(name_or_folder, str) and text in list_categories():
        return objects_folder() / text
    if not text or not Path(text).is_dir():
        raise CategoryError(
            "is neither a known category nor a folder", key=text or "category", choices=list_categories()
        )
    return Path(text)


def _folders() -> Iterator[Path]:
    root = objects_folder()
    if root.is_dir():
        yield from (folder for folder in root.iterdir() if (folder / FILE_NAME).is_file())


def load_scene(path: Path) -> "trimesh.Scene":
    """A GLB file, its vertices as they were written [m].

    Raises:
        CategoryError: unreadable, or without mesh.
    """
    scene = read_scene(path, error=CategoryError)
    if not scene.geometry:
        raise CategoryError("holds no mesh", path=path)
    return scene


def placed_parts(scene: "trimesh.Scene") -> list["trimesh.Trimesh"]:
    """Copies of a scene's parts where its nodes put them, in file order."""
    order = list(scene.geometry)
    parts = []
    for node in sorted(scene.graph.nodes_geometry, key=lambda node: order.index(scene.graph[node][1])):
        transform, name = scene.graph[node]
        part = scene.geometry[name].copy()
        if not np.array_equal(transform, np.eye(4)):
            part.apply_transform(transform)
        parts.append(part)
    return parts


def _as_mesh(scene: "trimesh.Scene") -> "trimesh.Trimesh":
    """All parts in one mesh, in file order; textures are packed into one picture."""
    import trimesh

    parts = placed_parts(scene)
    if len(parts) == 1:
        return parts[0]
    return trimesh.util.concatenate(parts)  # pyright: ignore[reportReturnType]  meshes give a mesh
