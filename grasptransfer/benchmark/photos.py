"""`bench photos`: real photographs with known poses; compares shapes where a mesh is known, else sizes."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from grasptransfer.benchmark.document import document
from grasptransfer.benchmark.errors_of_shape import outer_surface, shape_error
from grasptransfer.camera import Camera
from grasptransfer.category import Category, load_category
from grasptransfer.errors import SettingsError
from grasptransfer.perception.baselines import RigidEstimator, SimilarityEstimator
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.rgb import RgbEstimator

METHODS = ("rgb", "rigid", "similarity")
CANONICAL_POINTS = 8000


class _Intrinsics(BaseModel):
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class Photo(BaseModel):
    """One entry of `photos.yaml`; paths are relative to its folder, other keys are kept out of the way."""

    model_config = ConfigDict(extra="ignore")
    image: str
    category: str
    camera: _Intrinsics
    camera_from_object: list[list[float]]
    object: str | None = None
    mesh: str | None = None
    size_m: tuple[float, float, float] | None = None
    box: tuple[float, float, float, float] | None = None
    pose_kind: Literal["ground_truth", "pseudo"] | None = None


@dataclass(frozen=True)
class PhotoSettings:
    """What is measured.

    Args:
        photos: folder with `photos.yaml`.
        categories: names; entries of others are left out.
        refine_pose: whether `rgb` refines the given pose.
        told_box: whether the object's box is told, as a detector would.
    """

    photos: Path
    categories: tuple[str, ...]
    refine_pose: bool = True
    told_box: bool = True


def run_photo_benchmark(
    settings: PhotoSettings, *, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Errors of rgb, rigid and similarity on every photograph, as the contract's JSON document."""
    photos = [photo for photo in read_photos(settings.photos) if photo.category in settings.categories]
    if not photos:
        raise SettingsError(
            "holds no photograph of these categories", path=settings.photos, value=settings.categories
        )
    rows = []
    with Renderer() as renderer:
        flows: dict[str, RgbEstimator] = {}
        for done, photo in enumerate(photos, start=1):
            category = load_category(photo.category)
            if photo.category not in flows:
                flows[photo.category] = RgbEstimator(
                    category, renderer=renderer, refine_pose=settings.refine_pose
                )
            rows.append(
                _measure(photo, category, flows[photo.category], settings=settings, renderer=renderer)
            )
            if progress:
                progress(done, len(photos))
    return document("photos", settings=asdict(settings), rows=rows, summary=_summary(rows))


def read_photos(folder: Path) -> list[Photo]:
    """The entries of `folder/photos.yaml`.

    Raises:
        SettingsError: missing, not YAML, or an entry with a wrong key; names entry and key.
    """
    path = folder / "photos.yaml"
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        return TypeAdapter(list[Photo]).validate_python(data)
    except OSError as error:
        raise SettingsError("cannot be read", path=path, fix=str(error)) from error
    except yaml.YAMLError as error:
        raise SettingsError(f"is not valid YAML: {error}", path=path) from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SettingsError(first["msg"], path=path, key=f"entry {key}") from error


def _measure(
    photo: Photo, category: Category, rgb: RgbEstimator, *, settings: PhotoSettings, renderer
) -> dict:
    camera = Camera(**photo.camera.model_dump())
    told = observe(
        settings.photos / photo.image, np.array(photo.camera_from_object), camera=camera, mask=photo.box
    )
    seen = told if settings.told_box else replace(told, box=None)
    estimators: dict[str, tuple[Estimator, Observation]] = {
        "rgb": (rgb, seen),
        "rigid": (RigidEstimator(category), told),
        "similarity": (SimilarityEstimator(category), told),
    }
    truth = _true_mesh(photo, settings.photos)
    row = {
        "image": photo.image,
        "object": photo.object,
        "category": photo.category,
        "pose_kind": photo.pose_kind,
    }
    for name, (estimator, observation) in estimators.items():
        if name == "similarity" and told.box is None:
            continue
        estimate = estimator(observation)
        row[name] = _scores(estimate, category, photo, truth, observation=told, renderer=renderer)
        if name == "rgb":
            row["category_score"] = estimate.category_score
            row["mask_iou"] = _mask_iou(estimate, truth, told, renderer)
    return row


def _scores(
    estimate: ShapeEstimate, category: Category, photo: Photo, truth, *, observation: Observation, renderer
) -> dict[str, float]:
    mesh = category.canonical.copy()
    mesh.vertices = estimate.field(np.asarray(mesh.vertices))
    scores = {}
    if photo.size_m is not None:
        scores["size_error"] = float(np.abs(np.log(mesh.extents / np.array(photo.size_m))).mean())
    if truth is not None:
        error = shape_error(
            outer_surface(truth, CANONICAL_POINTS // 2),
            estimate.field(outer_surface(category.canonical, CANONICAL_POINTS)),
        )
        true_mask = renderer.depth(truth, observation.camera, observation.camera_from_object) > 0
        mask = renderer.depth(mesh, observation.camera, estimate.camera_from_object) > 0
        overlap = (mask & true_mask).sum() / max((mask | true_mask).sum(), 1)
        scores |= {"E": error.E, "rms_mm": error.rms_mm, "silhouette_iou": float(overlap)}
    return scores


def _mask_iou(estimate: ShapeEstimate, truth, observation: Observation, renderer) -> float | None:
    if truth is None or estimate.mask is None:
        return None
    true_mask = renderer.depth(truth, observation.camera, observation.camera_from_object) > 0
    return float((estimate.mask & true_mask).sum() / max((estimate.mask | true_mask).sum(), 1))


def _true_mesh(photo: Photo, folder: Path) -> trimesh.Trimesh | None:
    if photo.mesh is None:
        return None
    mesh = trimesh.load(folder / photo.mesh, force="mesh")
    if not isinstance(mesh, trimesh.Trimesh):
        raise SettingsError("holds no triangles", path=folder / photo.mesh)
    return mesh


def _summary(rows: list[dict]) -> dict:
    summary: dict[str, object] = {"photos": len(rows)}
    for other in ("rigid", "similarity"):
        wins = [_wins(row, other) for row in rows if other in row]
        summary[f"rgb_beats_{other}"] = float(np.mean(wins)) if wins else None
    per_category: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        per_category[row["category"]].append(row)
    for category, group in per_category.items():
        for method in METHODS:
            for score in ("E", "silhouette_iou", "size_error"):
                values = [row[method][score] for row in group if method in row and score in row[method]]
                if values:
                    summary[f"{category}_{method}_{score}_mean"] = float(np.mean(values))
        ious = [row["mask_iou"] for row in group if row.get("mask_iou") is not None]
        if ious:
            summary[f"{category}_mask_iou_mean"] = float(np.mean(ious))
    return summary


def _wins(row: dict, other: str) -> bool:
    score = "E" if "E" in row["rgb"] else "size_error"
    return row["rgb"][score] < row[other][score]
