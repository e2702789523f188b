"""`bench refusal`: how often right inputs are refused, and wrong ones noticed, named and kept from hands."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Annotated

import numpy as np
from PIL import Image
from tyro.conf import arg

from grasptransfer.camera import Camera
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.options import check_counts
from grasptransfer.perception.confidence import WRONG
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import Categories, name_trained
from grasptransfer.workshop.benchmark.photo_files import Photo, read_photos
from grasptransfer.workshop.benchmark.refusal_fit import pictured, write_verdicts
from grasptransfer.workshop.benchmark.refusal_table import summarise
from grasptransfer.workshop.benchmark.seen_instances import instance_names, load_instance
from grasptransfer.workshop.training.pictures import picture_of, radius_of
from grasptransfer.workshop.training.verdict_fit import draw_strangers
from grasptransfer.workshop.training.wrong_inputs import (
    Given,
    Pictured,
    foreign_object,
    right_inputs,
    without_object,
    wrong_cameras_and_boxes,
    wrong_poses,
)

TURNS_OF_A_PICTURE = 2
PHOTO, FOREIGN = "photo:", "foreign:"  # before the number, in the names of pieces
PICTURES_OF_A_PIECE = 4
PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class RefusalSettings:
    """What is measured.

    Args:
        categories: whose test instances are shown.
        pictures: of each category; every one gives each right and each wrong input once.
        photos: folder with `photos.yaml`, whose objects are shown as well.
        foreign: folder of photographs that show no object of the categories but those their folder names.
        seed: seed of pictures and inputs.
    """

    categories: Categories = ()
    pictures: Annotated[int, arg(help="pictures of each category.")] = 40
    photos: Path | None = None
    foreign: Path | None = None
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self)


def run_refusal_benchmark(
    settings: RefusalSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    write: bool = False,
) -> dict:
    """Every right and every wrong input of every picture, as JSON document.

    Args:
        workers: processes; each takes some pictures of one category at a time.
        ledger: file that an interrupted run resumes from.
        write: first fit the verdicts to as many pictures of random shapes, and to `photos`.

    Raises:
        SettingsError: a folder of photographs without any.
    """
    if write:
        known = {"photos": settings.photos, "seed": settings.seed + 1}
        write_verdicts(settings.categories, pictures=settings.pictures, progress=progress, **known)
    pieces = list(_pieces(settings))
    groups = measure_instances(
        measure_piece, settings, pieces, workers=workers, ledger=ledger, progress=progress
    )
    rows = [row for group in groups for row in group["rows"]]
    return document("refusal", settings=asdict(settings), rows=rows, summary=summarise(rows))


def _pieces(settings: RefusalSettings) -> Iterator[tuple[str, str]]:
    """Category and name of each piece: its kind, and the first of its pictures."""
    for category in settings.categories:
        counts = {"": settings.pictures}
        counts[PHOTO] = len(_photos_of(settings, category))
        counts[FOREIGN] = len(_foreign_to(settings, category))
        for kind, count in counts.items():
            yield from ((category, f"{kind}{first}") for first in range(0, count, PICTURES_OF_A_PIECE))


def measure_piece(settings: RefusalSettings, category: str, name: str) -> dict:
    """A few pictures, each with every input: rows of what was given and what was answered."""
    kind = next((one for one in (PHOTO, FOREIGN) if name.startswith(one)), "")
    first = int(name.removeprefix(kind))
    numbers = range(first, first + PICTURES_OF_A_PIECE)
    flow = GraspTransfer(category)
    if kind == PHOTO:
        inputs = _of_photos(settings, category, _photos_of(settings, category), numbers)
    elif kind == FOREIGN:
        inputs = _of_foreign_photos(settings, category, numbers)
    else:
        inputs = _of_pictures(settings, category, numbers)
    shown = "photograph" if kind else "picture"
    return {
        "rows": [
            {"category": category, "instance": f"{kind}{number}", "shown": shown} | answer_to(flow, given)
            for number, given in inputs
        ]
    }


def answer_to(flow: GraspTransfer, given: Given) -> dict:
    """What a user gets for an input: refusal, or status, warning, and usable grasps."""
    row = {"input": given.name, "verdict": given.verdict.value, "error": None}
    try:
        observation = given.observation()
        estimate = flow.estimator(observation)
    except GraspTransferError as error:
        return row | {"error": str(error), "noticed": True, "named": given.names(str(error)), "usable": 0}
    result = flow.grasp(observation, estimate)
    noticed = estimate.status in WRONG or estimate.warning is not None
    named = estimate.status is given.verdict or given.names(estimate.warning or "")
    return row | {
        "status": estimate.status.value,
        "warning": estimate.warning,
        "score": estimate.category_score,
        "noticed": noticed,
        "named": noticed and named,
        "usable": len(result.usable),
    }


def _of_pictures(
    settings: RefusalSettings, category: str, numbers: Iterable[int]
) -> Iterator[tuple[int, Given]]:
    """Test instances in turn, from random cameras."""
    names = instance_names(category, None)
    loaded = load_instance(category, names[0]).category
    least = radius_of(loaded.canonical.bounds)
    with Renderer() as renderer:
        for number in numbers:
            if number >= settings.pictures:
                return
            rng = np.random.default_rng([settings.seed, 8, number, *category.encode()])
            instance = load_instance(category, names[number % len(names)])
            points = np.asarray(instance.solid.vertices)
            seen = picture_of(instance.mesh, points, renderer, rng, least=least)
            strangers = draw_strangers(category, rng)
            foreign = []
            for _ in range(2):
                other, name = next(strangers)
                points = np.asarray(other.to_mesh().vertices)
                shown = picture_of(other, points, renderer, rng, least=least)
                foreign.append(_with_or_without_box(foreign_object(shown, name, rng), number))
            for given in (
                *right_inputs(seen, rng),
                *_with_or_without_box(without_object(seen, rng), number),
                *(one for group in foreign for one in group),
                *_some_turns(wrong_poses(seen, loaded, rng), rng),
                *wrong_cameras_and_boxes(seen, rng),
            ):
                yield number, given


def _of_photos(
    settings: RefusalSettings, category: str, photos: list[Photo], numbers: Iterable[int]
) -> Iterator[tuple[int, Given]]:
    assert settings.photos is not None
    loaded = _category(category)
    for number in numbers:
        if number >= len(photos):
            return
        photo = photos[number]
        rng = np.random.default_rng([settings.seed, 9, number, *category.encode()])
        seen = pictured(photo, settings.photos)
        named = photo.category == category
        inputs = (
            (
                *right_inputs(seen, rng),
                *_some_turns(wrong_poses(seen, loaded, rng), rng),
                *wrong_cameras_and_boxes(seen, rng),
            )
            if named
            else foreign_object(seen, "object of another category", rng)
        )
        yield from ((number, given) for given in inputs)


def _of_foreign_photos(
    settings: RefusalSettings, category: str, numbers: Iterable[int]
) -> Iterator[tuple[int, Given]]:
    """Photographs of other things, said to show the category: in their middle, from a random side."""
    paths = _foreign_to(settings, category)
    radius = radius_of(_category(category).canonical.bounds)
    for number in numbers:
        if number >= len(paths):
            return
        rng = np.random.default_rng([settings.seed, 10, number, *category.encode()])
        with Image.open(paths[number]) as opened:
            image = np.asarray(opened.convert("RGB"))
        yield from ((number, one) for one in _as_if(image, radius, rng))


def _as_if(image: np.ndarray, radius: float, rng: np.random.Generator) -> Iterator[Given]:
    from grasptransfer.drawing.views import sphere_views

    height, width = image.shape[:2]
    camera = Camera.from_fov(width, height, np.deg2rad(50))
    pose = sphere_views(camera.fy * 2 * radius / (0.8 * min(width, height)))[rng.integers(74)]
    box = (0.1 * width, 0.1 * height, 0.9 * width, 0.9 * height)
    return foreign_object(Pictured(image, camera, pose, box), "photograph of something else", rng)


def _with_or_without_box(inputs: Iterable[Given], number: int) -> Iterator[Given]:
    """Of two inputs that differ in the box alone every picture gets one; both then count as one kind."""
    for name, group in groupby(inputs, key=lambda given: given.name.removesuffix(", no box")):
        kinds = list(group)
        yield replace(kinds[number % len(kinds)], name=name)


def _some_turns(inputs: Iterable[Given], rng: np.random.Generator) -> list[Given]:
    """The inputs, with a few of the turned poses only."""
    kinds = list(inputs)
    turns = [index for index, given in enumerate(kinds) if given.name.startswith("turned ")]
    kept = set(rng.permutation(turns)[:TURNS_OF_A_PICTURE])
    return [given for index, given in enumerate(kinds) if index not in turns or index in kept]


def _photos_of(settings: RefusalSettings, category: str) -> list[Photo]:
    """Photographs with a box: the category's own, and every fourth of the others as foreign ones."""
    if settings.photos is None:
        return []
    photos = [photo for photo in read_photos(settings.photos) if photo.box is not None]
    own = [photo for photo in photos if photo.category == category]
    return own + [photo for photo in photos if photo.category != category][::4]


def _foreign_to(settings: RefusalSettings, category: str) -> list[Path]:
    """Photographs below `foreign` whose folder does not name the category; a mug is a cup, too."""
    if settings.foreign is None:
        return []
    alike = {category, "cup"} if category == "mug" else {category}
    every = [path for path in sorted(settings.foreign.rglob("*")) if path.suffix.lower() in PICTURE_SUFFIXES]
    if not every:
        raise SettingsError("holds no photographs", path=settings.foreign, key="foreign")
    return [path for path in every if not any(name in path.parent.name for name in alike)][::2]


@lru_cache(maxsize=8)
def _category(name: str):
    from grasptransfer.category import load_category

    return load_category(name)
