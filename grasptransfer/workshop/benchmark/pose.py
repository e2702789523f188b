"""`bench pose`: poses found from box and intrinsics alone, on renderings and photographs.

With `--random` it shows random shapes, and `--write` fits to them what turns traits into chances
(`perception/pose_search/chances.py`) and how far right proposals err.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.camera import Camera
from grasptransfer.category import load_category
from grasptransfer.drawing.boxes import Box
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at, towards
from grasptransfer.errors import SettingsError
from grasptransfer.meshes import load_mesh
from grasptransfer.options import check_counts
from grasptransfer.perception.pose_search.chances import FittedChances
from grasptransfer.perception.pose_search.finder import Fitted, PoseFinder
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import Categories, Meshes, ViewsOfEach, name_trained
from grasptransfer.workshop.benchmark.photo_files import Photo, read_photos
from grasptransfer.workshop.benchmark.pose_errors import ProposalError, pose_error, symmetry_turns
from grasptransfer.workshop.benchmark.pose_summary import RIGHT_DEGREES, summarise_poses, write_fit
from grasptransfer.workshop.benchmark.seen_instances import (
    CAMERA,
    Instance,
    instance_names,
    load_instance,
    random_names,
)
from grasptransfer.workshop.training.backgrounds import draw_backdrop
from grasptransfer.workshop.training.scenes import draw_lighting

HIGHEST, ROLL = np.deg2rad(70), np.deg2rad(5)
SIZES = (110, 330)  # px across
NO_EVIDENCE = ("evidence",)


@dataclass(frozen=True)
class PoseSettings:
    """What is measured.

    Args:
        photos: folder with photos.yaml; none: renderings.
        most: photographs of one object, spread over all there are.
        random: random shapes of each category in place of instances, and their first seed.
        seed: seed of views, lights and backgrounds.
    """

    categories: Categories = ()
    meshes: Meshes = None
    photos: Path | None = None
    views: ViewsOfEach = 2
    most: int = 12
    random: int = 0
    first_random: int = 70_000_000
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views", "most")
        if self.random < 0:
            raise SettingsError("must be 0 or more", key="random", value=self.random)
        if self.photos is not None and (self.random or self.meshes is not None):
            raise SettingsError("shows photographs alone", key="photos", value=str(self.photos))


def run_pose_benchmark(
    settings: PoseSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    write: bool = False,
) -> dict:
    """Errors of the proposals, as the contract's JSON document.

    Args:
        workers, ledger, progress: as for `measure_instances`.
        write: fit the chances to the random shapes shown, and write them.

    Raises:
        SettingsError: `write` without random shapes, or nothing to show.
    """
    if write and not settings.random:
        raise SettingsError("fits to random shapes alone", key="write", fix="Say how many: --random N")
    measure = measure_instance if settings.photos is None else measure_photos
    groups = measure_instances(
        measure, settings, _shown(settings), workers=workers, ledger=ledger, progress=progress
    )
    rows = [row for group in groups for row in group["rows"]]
    if write:
        write_fit(rows)
    rows = [{key: value for key, value in row.items() if key not in NO_EVIDENCE} for row in rows]
    return document("pose", settings=asdict(settings), rows=rows, summary=summarise_poses(rows))


def _shown(settings: PoseSettings) -> list[tuple[str, str]]:
    if settings.photos is not None:
        photos = [one for one in read_photos(settings.photos) if one.category in settings.categories]
        return list(dict.fromkeys((one.category, object_of(one)) for one in photos))
    if settings.random:
        names = random_names(settings.random, settings.first_random)
        return [(category, name) for name in names for category in settings.categories]
    return [(name, one) for name in settings.categories for one in instance_names(name, settings.meshes)]


def measure_instance(settings: PoseSettings, category: str, name: str) -> dict:
    """Views of one instance."""
    instance = load_instance(category, name, settings.meshes)
    turns, bounds = symmetry_turns(instance.solid), np.asarray(instance.solid.bounds)
    rows = []
    with Renderer() as renderer:
        for view in range(settings.views):
            rng = np.random.default_rng([settings.seed, view, *name.encode()])
            picture, pose, box = see_upright(instance, renderer, rng)
            row = {"category": category, "instance": name, "view": view}
            asked = _Asked(picture, CAMERA, box, pose, turns, bounds)
            rows.append(row | asked.answer(_finder(category), evidence=settings.random > 0))
    return {"rows": rows}


def measure_photos(settings: PoseSettings, category: str, name: str) -> dict:
    """Photographs of one object."""
    assert settings.photos is not None
    photos = [
        one for one in read_photos(settings.photos) if (one.category, object_of(one)) == (category, name)
    ]
    chosen = np.unique(np.linspace(0, len(photos) - 1, min(settings.most, len(photos))).round().astype(int))
    rows = []
    for photo in (photos[index] for index in chosen):
        bounds, turns = _known(photo, settings.photos)
        camera, pose = Camera(**photo.camera.model_dump()), np.array(photo.camera_from_object)
        asked = _Asked(settings.photos / photo.image, camera, photo.box, pose, turns, bounds)
        row = {"category": category, "instance": name, "image": photo.image}
        rows.append(row | asked.answer(_finder(category), evidence=False))
    return {"rows": rows}


def object_of(photo: Photo) -> str:
    """What a photograph shows."""
    return photo.object or photo.mesh or photo.image


@dataclass(frozen=True)
class _Asked:
    """A picture whose true pose is known.

    Args:
        picture, camera, box: as `find_pose` takes them.
        pose: the true one [m].
        turns: about the upright axis that leave the object as it is [rad].
        bounds: corners of its bounding box [m].
    """

    picture: object
    camera: Camera
    box: Box | None
    pose: Float[np.ndarray, "4 4"]
    turns: tuple[float, ...]
    bounds: Float[np.ndarray, "2 3"]

    def answer(self, finder: PoseFinder, *, evidence: bool) -> dict:
        """Errors of the proposals, and with `evidence` what the fitted chances depend on."""
        start = perf_counter()
        chances = FittedChances.read()
        picture: Any = self.picture
        seen = finder.see(picture, camera=self.camera, box=self.box)
        views = finder.score(seen)
        fits = finder.fit(seen, views, chances)
        seconds = perf_counter() - start
        shares = chances.poses.chances(np.stack([fit.traits for fit in fits])) if fits else np.zeros(0)
        order = np.argsort(-shares)
        errors = [self._error(fits[index], finder) for index in order]
        row: dict = {
            "seconds": round(seconds, 3),
            "proposals": [
                {"chance": round(float(shares[index]), 4), **error.as_data()}
                for index, error in zip(order, errors, strict=True)
            ],
        }
        if evidence:
            starts = [self._view_error(pose) for pose in views.poses]
            row["evidence"] = {
                "views": np.round(views.traits, 4).tolist(),
                "views_right": [degrees < RIGHT_DEGREES for degrees in starts],
                "poses": [np.round(fits[index].traits, 4).tolist() for index in order],
                "poses_right": [error.degrees < RIGHT_DEGREES for error in errors],
            }
        return row

    def _error(self, fit: Fitted, finder: PoseFinder) -> ProposalError:
        latent = fit.estimate.latent
        assert latent is not None
        vertices = finder.category.vertices_by_latent.displaced(
            np.asarray(finder.category.canonical.vertices), latent
        )
        found_bounds = np.stack([vertices.min(0), vertices.max(0)])
        pose = fit.estimate.camera_from_object
        return pose_error(pose, self.pose, self.turns, found_bounds=found_bounds, true_bounds=self.bounds)

    def _view_error(self, pose: Float[np.ndarray, "4 4"]) -> float:
        both = {"found_bounds": self.bounds, "true_bounds": self.bounds}
        return pose_error(pose, self.pose, self.turns, **both).degrees


def see_upright(instance: Instance, renderer: Renderer, rng: np.random.Generator):
    """A picture of an instance that stands before a camera held about level, its pose and its box."""
    radius = float(np.linalg.norm(np.abs(np.asarray(instance.solid.bounds)).max(0)))
    size = np.exp(rng.uniform(*np.log(SIZES)))
    margin = min(size / 2, 200)
    pixel = np.array(
        [rng.uniform(margin, CAMERA.width - margin), rng.uniform(margin, CAMERA.height - margin)]
    )
    pose = look_at(1.0, rng.uniform(0, 2 * np.pi), rng.uniform(0, HIGHEST), roll=rng.normal(0, ROLL))
    pose[:3, 3] = CAMERA.unproject(pixel, np.array(CAMERA.fx * 2 * radius / size))
    pose[:3, :3] = towards(pose[:3, 3]) @ pose[:3, :3]
    picture = renderer.render(instance.mesh, CAMERA, pose, lighting=draw_lighting(rng))
    v, u = np.nonzero(picture.mask)
    box = float(u.min()), float(v.min()), float(u.max()), float(v.max())
    return picture.over(draw_backdrop(rng, CAMERA.width, CAMERA.height)), pose, box


@lru_cache(maxsize=8)
def _finder(category: str) -> PoseFinder:
    return PoseFinder(category)


def _known(photo: Photo, folder: Path) -> tuple[Float[np.ndarray, "2 3"], tuple[float, ...]]:
    """Bounds and symmetry of the object in a photograph; without a mesh, bottles count as round."""
    if photo.mesh is not None:
        return _of_mesh(folder / photo.mesh)
    if photo.size_m is None:
        bounds = np.asarray(load_category(photo.category).canonical.bounds)
    else:
        bounds = np.array([-0.5, 0.5])[:, None] * np.array(photo.size_m)
    canonical = load_category(photo.category).canonical
    return bounds, symmetry_turns(canonical)


@lru_cache(maxsize=16)
def _of_mesh(path: Path) -> tuple[Float[np.ndarray, "2 3"], tuple[float, ...]]:
    mesh = load_mesh(path)
    return np.asarray(mesh.bounds), symmetry_turns(mesh)
