"""`bench photos`: real photographs with known poses; compares shapes where a mesh is known, else sizes."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from grasptransfer.category import Category, load_category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.frames import invert
from grasptransfer.options import check_counts
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.estimators import ESTIMATORS, EstimatorSettings, make_estimator
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.perception.reconstruction import reconstruct
from grasptransfer.perception.several_pictures import MOVED_CAMERA, SEPARATE
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.errors_of_shape import (
    CANONICAL_POINTS,
    CanonicalSurface,
    outer_surface,
)
from grasptransfer.workshop.benchmark.estimators import shown_to
from grasptransfer.workshop.benchmark.given_poses import REGIMES, GivenPoses
from grasptransfer.workshop.benchmark.grasp import Outcome, execute
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import Categories, Said, Together, Told, Weights, name_trained
from grasptransfer.workshop.benchmark.photo_files import (
    Photo,
    camera_of_photo,
    given_pose,
    given_poses_of,
    poses_on_file,
    read_photos,
    taken_beside,
)
from grasptransfer.workshop.benchmark.photo_summary import summarise_photos
from grasptransfer.workshop.benchmark.photo_truth import PhotoTruth, open_picture, overlap, silhouette_of

SHARE = 12  # A worker takes so many photographs of one object at a time.


@dataclass(frozen=True)
class PhotoSettings:
    """What is measured.

    Args:
        photos: folder with `photos.yaml`.
        told_box: give rgb the object's box, as a detector would.
        depth: also measure the estimators that use depth, on photographs that come with it.
        grasps: also execute transferred grasps, where a mesh is known.
    """

    photos: Path
    categories: Categories = ()
    views_together: Together = 1
    told: Told = "estimator"
    pose_sigma: Said = ()
    told_box: bool = True
    depth: bool = False
    grasps: bool = False
    weights: Weights = None

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views_together")
        _ = self.given

    @property
    def given(self) -> GivenPoses:
        """The given poses and their uncertainty; `told` may name a set of the folder's told_poses.yaml."""
        return GivenPoses.of(self.told, self.pose_sigma, names=poses_on_file(self.photos))


def run_photo_benchmark(
    settings: PhotoSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """Errors of every method on every photograph, as the contract's JSON document.

    Args:
        workers: processes; each takes some photographs of one object at a time.
        ledger: file that an interrupted run resumes from.

    Raises:
        SettingsError: `photos.yaml` is wrong, or holds no photograph of the categories.
    """
    photos = _photos_of(settings)
    if not photos:
        raise SettingsError(
            "holds no photograph of these categories", path=settings.photos, value=settings.categories
        )
    groups = measure_instances(
        measure_share, settings, _shares(photos), workers=workers, ledger=ledger, progress=progress
    )
    rows = [row for group in groups for row in group["rows"]]
    given = asdict(settings) | {"views_together": 1}
    return document("photos", settings=given, rows=rows, summary=summarise_photos(rows))


def _photos_of(settings: PhotoSettings) -> list[Photo]:
    """Photographs of the categories; a set on file need not have a pose of every photograph."""
    photos = [photo for photo in read_photos(settings.photos) if photo.category in settings.categories]
    source = settings.given.told
    if source in REGIMES:
        return photos
    named = {image for image, sets in given_poses_of(settings.photos).items() if source in sets}
    return [photo for photo in photos if photo.image in named]


def _shares(photos: list[Photo]) -> list[tuple[str, str]]:
    """Category and name of each share: an object, and the first of its photographs that belong to it."""
    counts = Counter((photo.category, _object_of(photo)) for photo in photos)
    starts = {found: range(0, count, SHARE) for found, count in counts.items()}
    return [(category, f"{name}#{start}") for (category, name), all_ in starts.items() for start in all_]


def measure_share(settings: PhotoSettings, category: str, name: str) -> dict:
    """Some of the photographs of one object: those from the number after `#` on."""
    known, _, first = name.rpartition("#")
    return measure_object(settings, category, known, slice(int(first), int(first) + SHARE))


def measure_object(settings: PhotoSettings, category: str, name: str, share: slice = slice(None)) -> dict:
    """All photographs of one object, or a share of them.

    Args:
        settings, category, name: what is measured, and category and name of the object.
        share: which of its photographs are measured.
    """
    loaded = load_category(category)
    photos = [p for p in _photos_of(settings) if (p.category, _object_of(p)) == (category, name)]
    with Renderer() as renderer:
        made_with = EstimatorSettings(weights=settings.weights)
        names = [name for name, spec in ESTIMATORS.items() if settings.depth or not spec.needs_depth]
        kit = {name: make_estimator(name, loaded, made_with) for name in names}
        rows = []
        for photo in photos[share]:
            given = _together(photo, photos, settings)
            rows.append(_measure(photo, given, loaded, kit, renderer=renderer, settings=settings))
        return {"rows": rows}


def _object_of(photo: Photo) -> str:
    return photo.object or photo.mesh or photo.image


def _measure(
    photo: Photo,
    given: Observation,
    category: Category,
    kit: dict[str, Estimator],
    *,
    renderer: Renderer,
    settings: PhotoSettings,
) -> dict:
    true_pose = np.array(photo.camera_from_object)
    row = {
        "image": photo.image,
        "object": _object_of(photo),
        "category": photo.category,
        "pose_kind": photo.pose_kind,
    }
    truth = PhotoTruth.of(photo, settings.photos, given, renderer)
    executes = settings.grasps and truth.mesh is not None
    flow = GraspTransfer(category, estimator=kit["rgb"]) if executes else None  # Its estimator is not called.
    for name, observation in _seen_by(kit, given, told_box=settings.told_box).items():
        try:
            estimate = kit[name](observation)
        except GraspTransferError as error:
            if not ESTIMATORS[name].needs_depth:
                raise
            row[f"{name}_failed"] = str(error)
            continue
        row[name] = _scores(estimate, category, photo, truth, renderer=renderer)
        if flow is not None and truth.mesh is not None:
            result = flow.grasp(observation, estimate)
            row[name] |= _executed(execute(result, true_pose, truth.mesh))
        if name == "rgb":
            row["category_score"] = estimate.category_score
            row["status"] = estimate.status.value
            row["mask_iou"] = truth.overlap(estimate, category, renderer)
            row |= truth.placed(estimate, category, given=observation, true_pose=true_pose)
    return row


def _seen_by(names: Iterable[str], given: Observation, *, told_box: bool) -> dict[str, Observation]:
    """What each estimator sees of the photograph; those that need what it comes without are left out."""
    picture = given.without("mask", "depth", *(() if told_box else ("box",)))
    seen = {}
    for name in names:
        spec = ESTIMATORS[name]
        needed = (spec.needs_box, given.box), (spec.needs_mask, given.mask), (spec.needs_depth, given.depth)
        if any(needs and missing is None for needs, missing in needed):
            continue
        seen[name] = shown_to(name, given if spec.needs_box or spec.needs_depth else picture)
    return seen


def _executed(outcome: Outcome) -> dict:
    """Whether the best-ranked grasp held, and the success it was said to have; the others beside it."""
    usable = outcome.usable_held
    return {
        "grasp_held": outcome.best_held,
        "grasp_stated": None if outcome.best is None else outcome.best.stated,
        "usable": len(usable),
        "usable_held": sum(usable),
        "executed": [asdict(chance) for chance in outcome.chances],
    }


def _together(photo: Photo, photos: list[Photo], settings: PhotoSettings) -> Observation:
    """The photograph, and those of the same object that are seen together with it.

    Poses with a drawn error have the same one, as of a camera that moved; those of a set on file err each by
    itself.
    """
    first, further = _observation(photo, settings), []
    drawn = settings.given.told in REGIMES
    for other in taken_beside(photo, photos, settings.views_together - 1):
        seen = _observation(other, settings)
        if drawn:
            moved = np.array(other.camera_from_object) @ invert(np.array(photo.camera_from_object))
            seen = replace(seen, camera_from_object=moved @ first.camera_from_object)
        further.append(seen)
    return replace(first, further=tuple(further), views=MOVED_CAMERA if drawn else SEPARATE)


def _observation(photo: Photo, settings: PhotoSettings) -> Observation:
    """The photograph with its given pose; the true mask is for the methods that use depth alone."""
    folder = settings.photos
    pose = given_pose(photo, folder, settings.given)
    about = {
        "camera": camera_of_photo(photo),
        "box": photo.box,
        "pose_sigma": settings.given.pose_sigma,
    }
    seen = observe(folder / photo.image, pose, **about)
    if not settings.depth or photo.depth is None:
        return seen
    millimetres = np.asarray(open_picture(folder / photo.depth), float)
    measured = observe(seen.image, pose, depth=millimetres / 1000, **about)
    mask = None if photo.mask is None else np.asarray(open_picture(folder / photo.mask).convert("L")) > 127
    return replace(measured, mask=mask)


def _scores(
    estimate: ShapeEstimate, category: Category, photo: Photo, truth: PhotoTruth, *, renderer: Renderer
) -> dict[str, float | None]:
    mesh = reconstruct(category, estimate.field, latent=estimate.latent)
    scores: dict[str, float | None] = {}
    if photo.size_m is not None:
        scores["size_error"] = float(np.abs(np.log(mesh.extents / np.array(photo.size_m))).mean())
    if truth.surface is not None:
        error = truth.surface.error(_canonical_surface(category.name).warped(estimate.field))
        drawn = silhouette_of(estimate, category, truth.camera, renderer)
        scores |= {
            "E": error.E,
            "rms_mm": error.rms_mm,
            "chamfer_mm": error.chamfer_mm,
            "silhouette_iou": overlap(drawn, truth.silhouette),
        }
    return scores


@lru_cache(maxsize=8)
def _canonical_surface(category: str) -> CanonicalSurface:
    return CanonicalSurface(outer_surface(load_category(category).canonical, CANONICAL_POINTS))
