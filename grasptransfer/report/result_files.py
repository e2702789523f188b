"""A transfer on disk: grasps.yaml, reconstruction.glb, field.npz, result.yaml and silhouette.png, each whole.

result.yaml holds every grasp with status and reason; grasps.yaml only those that may be executed.
silhouette.png is white where the reconstruction is in the first picture, hidden parts too.
Poses are in metres: `object` is the reconstruction's frame, `gripper` the TCP (+z approach, +x closing).
"""

import hashlib
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
import yaml
from jaxtyping import Bool
from PIL import Image

import grasptransfer
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole, writing
from grasptransfer.grasping import PlacedGrasp
from grasptransfer.grasping.formats import GraspSet, isaac_grasp

if TYPE_CHECKING:
    from grasptransfer.perception.observation import Observation
    from grasptransfer.perception.pose_prior import PoseDeviation
    from grasptransfer.result import TransferredGrasp, TransferResult

GRASPS, RECONSTRUCTION, FIELD, RESULT = "grasps.yaml", "reconstruction.glb", "field.npz", "result.yaml"
SILHOUETTE = "silhouette.png"


def save_result(result: "TransferResult", folder: Path) -> Path:
    """Write grasps.yaml, reconstruction.glb, field.npz, result.yaml and silhouette.png into `folder`.

    Raises:
        SettingsError: the folder cannot be written.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_isaac_grasp(result, folder / GRASPS)
        write_reconstruction(result.mesh, folder / RECONSTRUCTION)
        result.field.save(folder / FIELD)
        text = yaml.dump(as_data(result), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=110)
        write_whole(folder / RESULT, text.encode())
        write_whole(folder / SILHOUETTE, _png(result.silhouette))
    return folder


def _png(inside: Bool[np.ndarray, "h w"]) -> bytes:
    """White where it is true."""
    content = io.BytesIO()
    Image.fromarray(inside).save(content, "PNG")
    return content.getvalue()


def write_isaac_grasp(result: "TransferResult", path: Path) -> Path:
    """Write the usable grasps, best first, as isaac_grasp YAML: object frame, TCP, score as confidence."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        grasps = tuple(_placed(grasp) for grasp in result.usable)
        isaac_grasp.write(GraspSet(grasps, object_frame="object"), path, result.gripper)
    return path


def write_reconstruction(mesh: trimesh.Trimesh, path: Path) -> Path:
    """Write the reconstruction as GLB, vertices in the object frame [m]."""
    # Fresh normals: those of the canonical model do not fit the warped surface.
    fresh = trimesh.Trimesh(
        np.asarray(mesh.vertices), np.asarray(mesh.faces), visual=mesh.visual, process=False
    )
    content = trimesh.Scene(fresh).export(file_type="glb", include_normals=True)
    assert isinstance(content, bytes)
    write_whole(path, content)
    return path


def check_folder(path: Path, key: str) -> None:
    """
    Raises:
        SettingsError: `path` is a file, where the argument `key` is to be a folder, there or not yet.
    """
    if path.exists() and not path.is_dir():
        raise SettingsError("is not a folder", path=path, key=key)


def as_data(result: "TransferResult") -> dict:
    """Everything but the arrays of points, as plain numbers and names."""
    observation = result.observation
    return {
        "format": "grasptransfer_result",
        "format_version": 1,
        "grasptransfer": grasptransfer.__version__,
        "category": result.category.name,
        "canonical_sha256": result.category.canonical_sha256,
        "gripper": result.gripper.name,
        "status": result.status.value,
        "advice": result.advice,
        "category_score": None if result.category_score is None else round(result.category_score, 4),
        "length_unit": "m",
        **_picture_data(observation),
        "views": observation.views,
        "further_pictures": [_picture_data(picture) for picture in observation.further],
        "camera_from_object": _rows(result.camera_from_object),
        **_found(result),
        "pose_sigma_prior": _deviation(result.pose_sigma_prior),
        "pose_sigma_posterior": _deviation(result.pose_sigma_posterior),
        "extents": _numbers(result.mesh.extents),
        "latent": None if result.latent is None else _numbers(result.latent),
        "latent_std": None
        if result.latent_covariance is None
        else _numbers(np.sqrt(np.diag(result.latent_covariance))),
        "seconds": {name: round(float(seconds), 4) for name, seconds in result.timings.items()},
        "usable": len(result.usable),
        "grasps": {grasp.name: _grasp_data(grasp) for grasp in result.grasps},
    }


def _picture_data(picture: "Observation") -> dict:
    """A picture, its camera and its given pose."""
    camera = picture.camera
    return {
        "image": {
            "width": camera.width,
            "height": camera.height,
            "sha256": hashlib.sha256(picture.image.tobytes()).hexdigest(),
        },
        "camera": {name: float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy")},
        "given_camera_from_object": _rows(picture.camera_from_object),
    }


def _found(result: "TransferResult") -> dict:
    """Poses that were found in the picture, where none was given."""
    poses = [
        {"chance": round(pose.chance, 4), "camera_from_object": _rows(pose.camera_from_object)}
        for pose in result.found_poses
    ]
    return {"pose_note": result.pose_note, "found_poses": poses} if poses else {}


def _grasp_data(grasp: "TransferredGrasp") -> dict:
    return {
        "label": grasp.label,
        "status": grasp.status.value,
        "usable": grasp.usable,
        "reason": grasp.reason,
        "score": round(float(grasp.score), 4),
        "score_deviation": round(float(grasp.score_deviation), 4),
        "width": round(float(grasp.width), 5),
        "opening": round(float(grasp.opening), 5),
        "approach_distance": round(float(grasp.approach_distance), 5),
        "object_from_gripper": _rows(grasp.object_from_gripper),
        "camera_from_gripper": _rows(grasp.camera_from_gripper),
        **_in_world(grasp),
        "contacts": None if grasp.contacts is None else _rows(grasp.contacts),
    }


def _placed(grasp: "TransferredGrasp") -> PlacedGrasp:
    return PlacedGrasp(
        name=grasp.name,
        label=grasp.label,
        object_from_gripper=grasp.object_from_gripper,
        width=grasp.width,
        approach_distance=grasp.approach_distance,
        contacts=grasp.contacts,
        confidence=float(np.clip(grasp.score, 0, 1)),
        opening=grasp.opening,
    )


def _deviation(sigma: "PoseDeviation | None") -> dict[str, float] | None:
    """Metres and degrees."""
    if sigma is None:
        return None
    names = {"along_ray": sigma.along_ray, "across_ray": sigma.across_ray, "turn_degrees": sigma.turn}
    return {name: round(value, 6) for name, value in names.items()}


def _in_world(grasp: "TransferredGrasp") -> dict:
    known = grasp.world_from_camera is not None
    return {"world_from_gripper": _rows(grasp.world_from_gripper)} if known else {}


def _numbers(values) -> list[float]:
    return [round(float(value), 6) for value in values]


def _rows(matrix) -> list[list[float]]:
    return [[round(float(value), 9) for value in row] for row in matrix]


class _Dumper(yaml.SafeDumper):
    """Without the `&id001` that YAML puts where one list occurs twice."""

    def ignore_aliases(self, data):
        return True
