"""A valid file of every format that the package reads, and how it is read."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from PIL import Image

POSE = [[1.0, 0, 0, 0.01], [0, 0, -1.0, 0.02], [0, 1.0, 0, 0.6], [0, 0, 0, 1.0]]
CAMERA = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "width": 640, "height": 480}


@dataclass(frozen=True)
class Format:
    """One kind of file.

    Args:
        name: for the table.
        file: name of the file that is damaged, inside a folder of the sample's own.
        make: writes a valid sample into a folder, with all files that it needs.
        read: reads it, given the path of `file`; what it returns must hold finite numbers only.
        text: whether it is text, so that numbers and words are exchanged, too.
    """

    name: str
    file: str
    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    text: bool = True


def formats() -> tuple[Format, ...]:
    """Every format that is read, in the order of the table."""
    makers = (_settings_files, _seen_files, _grasp_files, _array_files, _mesh_files, _picture_files)
    return tuple(kind for make in makers for kind in make())


def _settings_files() -> list[Format]:
    import grasptransfer as gt
    from grasptransfer.category.settings import CategoryFile

    def category(folder: Path) -> None:
        shutil.copy(gt.load_category("mug").folder / "category.yaml", folder)

    def gripper(folder: Path) -> None:
        source = gt.load_gripper("parallel_jaw").path
        for path in source.parent.glob(f"{source.stem}*"):
            (shutil.copytree if path.is_dir() else shutil.copy)(path, folder / path.name)

    jaw = "parallel_jaw"
    return [
        Format("category.yaml", "category.yaml", category, lambda path: CategoryFile.load(path.parent)),
        Format("gripper YAML", f"{jaw}.yaml", gripper, gt.load_gripper),
        Format("URDF", f"{jaw}.urdf", gripper, lambda path: gt.load_gripper(path.with_name(f"{jaw}.yaml"))),
    ]


def _seen_files() -> list[Format]:
    import grasptransfer as gt
    from grasptransfer.poses import read_pose

    def pose(folder: Path) -> None:
        (folder / "pose.yaml").write_text(yaml.safe_dump({"camera_from_object": POSE}))

    def bop(folder: Path) -> None:
        entry = {
            "cam_R_m2c": [number for row in POSE[:3] for number in row[:3]],
            "cam_t_m2c": [10.0, 20.0, 600.0],
        }
        (folder / "pose.json").write_text(json.dumps(entry | {"obj_id": 3}))

    def camera(folder: Path) -> None:
        (folder / "camera.yaml").write_text(yaml.safe_dump(CAMERA))

    def scene(folder: Path) -> None:
        trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "box.obj")
        plane = {"point": [0.0, 0.1, 0.6], "normal": [0.0, -1.0, 0.0]}
        box = {"mesh": "box.obj", "camera_from_obstacle": POSE}
        wall = {"box": [0.1, 0.2, 0.3], "camera_from_obstacle": POSE}
        data = {"support_plane": plane, "obstacles": {"box": box, "wall": wall}}
        (folder / "scene.yaml").write_text(yaml.safe_dump(data))

    return [
        Format("pose YAML", "pose.yaml", pose, lambda path: read_pose(path).camera_from_object),
        Format("pose BOP", "pose.json", bop, lambda path: read_pose(path).camera_from_object),
        Format("camera YAML", "camera.yaml", camera, gt.Camera.load),
        Format("scene YAML", "scene.yaml", scene, gt.load_scene),
        Format("obstacle mesh", "box.obj", scene, lambda path: gt.load_scene(path.with_name("scene.yaml"))),
    ]


def _grasp_files() -> list[Format]:
    import grasptransfer as gt
    from grasptransfer.grasping import load_grasps
    from grasptransfer.grasping.formats import convert, read_grasps

    mug = gt.load_category("mug").grasps_path

    def own(folder: Path) -> None:
        shutil.copy(mug, folder / "grasps.yaml")

    def converted(name: str) -> Callable[[Path], Any]:
        return lambda folder: convert(mug, folder / name, gripper="panda")

    def read(path: Path) -> Any:
        return read_grasps(path, gripper="panda")

    foreign = (
        ("isaac_grasp", "isaac.yaml", True),
        ("GraspGen", "a.json", True),
        ("ACRONYM", "a.h5", False),
        ("graspnet", "a.npy", False),
    )
    kinds = [Format(name, file, converted(file), read, text) for name, file, text in foreign]
    return [Format("grasps.yaml", "grasps.yaml", own, lambda path: load_grasps(path, category="mug")), *kinds]


def _array_files() -> list[Format]:
    import grasptransfer as gt
    from grasptransfer.perception.weights import load_weights
    from grasptransfer.registration import DeformationField, ShapeSpace

    mug = gt.load_category("mug")

    def field(folder: Path) -> None:
        mug.field(mug.train[0]).save(folder / "field.npz")

    def space(folder: Path) -> None:
        shutil.copy(mug.folder / "shape_space.npz", folder)

    def weights(folder: Path) -> None:
        from grasptransfer.perception.weights import find_weights

        shutil.copy(find_weights(mug), folder / "net.safetensors")

    return [
        Format("field npz", "field.npz", field, DeformationField.load, text=False),
        Format("shape space npz", "shape_space.npz", space, ShapeSpace.load, text=False),
        Format("safetensors", "net.safetensors", weights, lambda path: load_weights(path)[1], text=False),
    ]


def _mesh_files() -> list[Format]:
    from grasptransfer.meshes import load_mesh
    from grasptransfer.workshop.building.sources import prepare

    ball = trimesh.creation.icosphere(2, 0.05)

    def mesh(name: str) -> Callable[[Path], Any]:
        return lambda folder: ball.export(folder / name)

    def prepared(path: Path) -> Any:
        return prepare(path, scale=1.0, rotation=np.eye(3)).mesh.vertices

    def xyz(folder: Path) -> None:
        np.savetxt(folder / "a.xyz", ball.vertices)

    def pcd(folder: Path) -> None:
        header = (
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\n"
        )
        content = header.format(n=len(ball.vertices)).encode() + b"DATA binary\n"
        (folder / "a.pcd").write_bytes(content + np.asarray(ball.vertices, np.float32).tobytes())

    kinds = (("glb", False), ("obj", True), ("ply", False), ("stl", False), ("off", True))
    meshes = [Format(kind, f"a.{kind}", mesh(f"a.{kind}"), load_mesh, text) for kind, text in kinds]
    clouds = [Format("xyz", "a.xyz", xyz, prepared), Format("pcd", "a.pcd", pcd, prepared, text=False)]
    return [*meshes, *clouds]


def _picture_files() -> list[Format]:
    from grasptransfer.perception.observation import read_image

    rng = np.random.default_rng(0)
    picture = Image.fromarray(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))

    def saved(name: str) -> Callable[[Path], Any]:
        return lambda folder: picture.save(folder / name)

    return [
        Format("PNG", "a.png", saved("a.png"), read_image, text=False),
        Format("JPEG", "a.jpg", saved("a.jpg"), read_image, text=False),
    ]
