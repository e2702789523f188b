"""Writing a category folder: all of it or nothing."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.category.category import (
    CANONICAL,
    FIELDS,
    FIELDS_KIND,
    PREVIEW,
    SHAPE_SPACE,
    Category,
    load_category,
    load_scene,
)
from grasptransfer.category.settings import DENSITY, CategoryFile, Settings, Split, software_versions
from grasptransfer.drawing.contact_sheet import portrait
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.sheet import encoded, sheet
from grasptransfer.errors import CategoryError
from grasptransfer.files import sha256, write_whole
from grasptransfer.registration import ShapeSpace
from grasptransfer.registration.storage import save_arrays

TILE, COLUMNS, WHITE = 150, 8, (255, 255, 255)
_UINT16, _UINT32 = 5123, 5125  # component types of glTF


@dataclass(frozen=True, eq=False)
class CategoryContent:
    """All that a category folder holds.

    Args:
        name: name of the category.
        description: for people.
        split: names of the instances, train and test.
        settings: how the shape space was made.
        measured: figures of the build, by name with their unit.
        canonical_glb: glTF 2.0 binary in the category's frame.
        instance_glbs: likewise, by the instance's name.
        shape_space: shape space of the train instances.
        weights: (n, 3) of each instance's field, normalised units, by name.
        density: of what an instance is made of, kg/m3 of the solid that its mesh encloses.
    """

    name: str
    description: str
    split: Split
    settings: Settings
    measured: dict
    canonical_glb: bytes
    instance_glbs: dict[str, bytes]
    shape_space: ShapeSpace
    weights: dict[str, Float[np.ndarray, "n 3"]]
    density: float = DENSITY


def write_category(folder: Path, content: CategoryContent) -> Category:
    """Write a category folder beside its place, then move it there; what else an older one held is kept."""
    folder = Path(folder)
    staging, replaced = folder.with_name(f".{folder.name}.part"), folder.with_name(f".{folder.name}.old")
    _clear_up(folder, staging, replaced)
    try:
        _write_models(staging, content)
        content.shape_space.save(staging / SHAPE_SPACE)
        _write_fields(staging, content.weights)
        paths = sorted(path for path in staging.rglob("*") if path.is_file())
        CategoryFile(
            name=content.name,
            description=content.description,
            density=content.density,
            split=content.split,
            settings=content.settings,
            measured=content.measured,
            checksums={path.relative_to(staging).as_posix(): sha256(path) for path in paths},
            versions=software_versions(),
        ).save(staging)
        _keep_others(folder, staging)
        _put_in_place(staging, folder, replaced)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return load_category(folder)


def _write_models(staging: Path, content: CategoryContent) -> None:
    """The models, and a picture of them all."""
    write_whole(staging / CANONICAL, content.canonical_glb)
    for instance, glb in content.instance_glbs.items():
        write_whole(staging / f"instances/{instance}.glb", glb)
    write_whole(staging / PREVIEW, _preview(staging, content.split))


def _write_fields(staging: Path, weights: dict[str, Float[np.ndarray, "n 3"]]) -> None:
    stacked = np.stack(list(weights.values())).astype(np.float32)
    save_arrays(staging / FIELDS, FIELDS_KIND, {"names": np.array(list(weights)), "weights": stacked})


def _keep_others(folder: Path, staging: Path) -> None:
    """Grasps, and whatever else lies in the older folder and was not written with it."""
    if not folder.is_dir():
        return
    try:
        known = set(CategoryFile.load(folder).checksums)
    except CategoryError:  # one that is broken is to be replaced: nothing is known of its files
        known = set()
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if path.is_file() and relative.as_posix() not in known and not (staging / relative).exists():
            (staging / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, staging / relative)


def _clear_up(folder: Path, staging: Path, replaced: Path) -> None:
    """What a killed run left behind; it may have had the older folder in its hands."""
    if replaced.exists() and not folder.exists():
        os.replace(replaced, folder)
    for leftover in (staging, replaced):
        shutil.rmtree(leftover, ignore_errors=True)


def _put_in_place(staging: Path, folder: Path, replaced: Path) -> None:
    if folder.exists():
        os.replace(folder, replaced)
    os.replace(staging, folder)
    shutil.rmtree(replaced, ignore_errors=True)


def _preview(staging: Path, split: Split) -> bytes:
    captions, files = ["canonical"], [CANONICAL]
    for kind, names in (("train", split.train), ("test", split.test)):
        captions += [kind] * len(names)
        files += [f"instances/{name}.glb" for name in names]
    scenes = [load_scene(staging / file) for file in files]
    for number, scene in enumerate(scenes[1:], 1):
        captions[number] += f": {' x '.join(f'{1000 * side:.0f}' for side in scene.extents)} mm"
    with Renderer() as renderer:
        tiles = [portrait(scene, renderer, TILE, ground=WHITE) for scene in scenes]
    return encoded(sheet(tiles, COLUMNS, captions=captions))


def glb_of(scene: trimesh.Scene | trimesh.Trimesh) -> bytes:
    """glTF 2.0 binary of a scene, normals included."""
    scene = scene if isinstance(scene, trimesh.Scene) else trimesh.Scene(scene)
    content = scene.export(file_type="glb", include_normals=True, buffer_postprocessor=_shorten_indices)
    assert isinstance(content, bytes)
    return content


def _shorten_indices(buffers: dict[int, bytes], tree: dict) -> None:
    """Write face indices in two bytes instead of four where they fit."""
    keys, accessors = list(buffers), list(tree["accessors"].values())
    faces = {primitive["indices"] for mesh in tree["meshes"] for primitive in mesh["primitives"]}
    shortened = set()
    for accessor in (accessors[number] for number in sorted(faces)):
        key = keys[accessor["bufferView"]]
        if accessor["componentType"] != _UINT32 or accessor["max"][0] >= 2**16 - 1:
            continue
        if key not in shortened:
            indices = np.frombuffer(buffers[key], "<u4")[: accessor["count"]].astype("<u2")
            buffers[key] = indices.tobytes() + b"\0" * (-indices.nbytes % 4)
            shortened.add(key)
        accessor["componentType"] = _UINT16
