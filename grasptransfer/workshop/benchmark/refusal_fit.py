"""`bench refusal --write`: fit the verdicts to random shapes, and to photographs, which then are no test."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from grasptransfer.camera import Camera
from grasptransfer.category import load_category
from grasptransfer.perception.observation import read_image
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.weights import find_weights, read_weights, write_confidence
from grasptransfer.workshop.benchmark.photo_files import Photo, read_photos
from grasptransfer.workshop.training.verdict_fit import (
    Seen,
    fit_verdicts,
    see_photographs,
    see_random_shapes,
)
from grasptransfer.workshop.training.wrong_inputs import Pictured


def write_verdicts(
    categories: Sequence[str],
    *,
    pictures: int,
    photos: Path | None,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Fit the verdicts of the shipped networks, write them beside the weights and return the file.

    Args:
        categories: of one weight file.
        pictures: pictures of random shapes of each category.
        photos: folder with `photos.yaml`, or None.
        seed: seed of shapes, pictures and inputs.
        progress: called with (pictures done, in all).
    """
    weights = find_weights(load_category(categories[0]))
    seen: list[Seen] = []
    done = 0

    def step():
        nonlocal done
        done += 1
        if progress:
            progress(done, pictures * len(categories))

    for name in categories:
        estimator = RgbEstimator(load_category(name), weights=weights)
        seen += see_random_shapes(estimator, pictures, seed=seed, progress=step)
        if photos is not None:
            shown = (pictured(one, photos) for one in read_photos(photos) if one.category == name and one.box)
            seen += see_photographs(estimator, shown, seed=seed)
    verdicts, of_pass, of_pose = fit_verdicts(seen)
    confidence = replace(
        read_weights(weights).info.confidence, verdicts=verdicts, of_pass=of_pass, of_pose=of_pose
    )
    write_confidence(weights, confidence)
    return weights.with_suffix(".yaml")


def pictured(photo: Photo, folder: Path) -> Pictured:
    """A photograph with its camera, true pose and box."""
    assert photo.box is not None
    camera, pose = Camera(**photo.camera.model_dump()), np.array(photo.camera_from_object)
    return Pictured(read_image(folder / photo.image), camera, pose, photo.box)
