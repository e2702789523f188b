"""Fit `Confidence` to a trained network: on held-out shapes, and on objects of other kinds."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from grasptransfer.category import Category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import towards
from grasptransfer.perception.confidence import Confidence, Evidence
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.weights import FITTED, load_weights, write_confidence
from grasptransfer.workshop import objects
from grasptransfer.workshop.training.backgrounds import draw_backdrop
from grasptransfer.workshop.training.random_objects import draw_random_object
from grasptransfer.workshop.training.scenes import draw_camera, draw_lighting, draw_pose
from grasptransfer.workshop.training.training_shapes import (
    draw_training_shape,
    instances_of,
    training_canonical,
)

OCCLUDED = 0.25  # share of the pictures
HIDDEN = (0.02, 0.35)  # share of the object that an occluder may hide
INTERVAL = 0.9
NORMAL_90 = 1.645  # standard deviations on either side that hold 90 % of a normal distribution
RIDGE = 1e-3


@dataclass(frozen=True)
class Seen:
    """The outcome of one picture: the evidence for the category, and the error of the latent.

    Args:
        own: whether the object is of the category.
        errors: (k,) errors of the latent over its stated deviations, before `overconfidence`; None for
            strangers.
    """

    own: bool
    evidence: Evidence
    errors: Float[np.ndarray, "k"] | None = None


def fit_confidence(
    weights: Path,
    categories: Sequence[Category],
    *,
    pictures: int = 40,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Confidence:
    """Fit the confidence of a weight file to pictures, and write it beside that file.

    Args:
        categories: that it was trained on.
        pictures: pictures of held-out shapes (`training_shapes.instances_of`), and as many of strangers, of
            each category.
        seed: seed of shapes, pictures and strangers.
        progress: called with (pictures done, in all).
    """
    confidence = load_weights(weights)[1].confidence
    total = 2 * pictures * len(categories)
    seen: list[Seen] = []
    for number, category in enumerate(categories):
        rng = np.random.default_rng([seed, 5, number])
        for one in _assess_objects(category, weights, pictures, rng):
            seen.append(one)
            if progress:
                progress(len(seen), total)
    fitted = replace(fit_score(seen), overconfidence=fit_overconfidence(seen)).as_data()
    confidence = replace(confidence, **{name: fitted[name] for name in FITTED})
    write_confidence(weights, confidence)
    return confidence


def fit_score(seen: list[Seen]) -> Confidence:
    """Logistic regression on the evidence; own objects and strangers count the same, however many."""
    own = np.array([one.own for one in seen])
    rows = np.array([[1.0, *one.evidence] for one in seen])
    share = np.where(own, 0.5 / own.sum(), 0.5 / (~own).sum())
    sign = np.where(own, -1.0, 1.0)

    def loss(weights):
        return share @ np.logaddexp(0, sign * (rows @ weights)) + RIDGE * weights[1:] @ weights[1:]

    return Confidence(*(float(value) for value in minimize(loss, np.zeros(rows.shape[1])).x))


def fit_overconfidence(seen: list[Seen]) -> float:
    """The factor on the squared deviations with which 90 % intervals hold the truth in 90 % of the cases."""
    errors = np.concatenate([one.errors for one in seen if one.errors is not None])
    return float(max(np.quantile(np.abs(errors), INTERVAL) / NORMAL_90, 1.0) ** 2)


def _assess_objects(
    category: Category, weights: Path, pictures: int, rng: np.random.Generator
) -> Iterator[Seen]:
    canonical, instances = training_canonical(category), instances_of(category, held_out=True)
    with Renderer() as renderer:
        estimator = RgbEstimator(category, weights=weights, refine_pose=False)
        estimator.confidence = replace(estimator.confidence, overconfidence=1.0)
        least = _radius(category.canonical.bounds)
        for _ in range(pictures):
            shape = draw_training_shape(canonical, instances, rng)
            estimate, evidence = estimator.assess(_picture_of(shape.scene, renderer, rng, least))
            assert estimate.latent is not None
            assert estimate.latent_covariance is not None
            known = len(shape.latent)
            deviations = np.sqrt(np.diag(estimate.latent_covariance))[:known]
            yield Seen(True, evidence, (estimate.latent[:known] - shape.latent) / deviations)
        for stranger in _strangers(category.name, pictures, rng):
            yield Seen(False, estimator.assess(_picture_of(stranger, renderer, rng, least))[1])


def _strangers(name: str, count: int, rng: np.random.Generator) -> Iterator[trimesh.Scene]:
    """Objects of the other categories, and as many of none."""
    others = [other for other in objects.generators() if other != name]
    for index in range(count):
        if index % 2:
            yield draw_random_object(rng)
        else:
            yield objects.sample(others[index // 2 % len(others)], int(rng.integers(2**31))).scene()


def _radius(bounds) -> float:
    """Radius of a sphere about the origin that holds the bounding box [m]."""
    return float(np.linalg.norm(np.abs(bounds).max(0)))


def _picture_of(scene, renderer: Renderer, rng: np.random.Generator, least: float) -> Observation:
    """A random picture with the true pose and no box; sometimes another object stands before the object.

    Args:
        scene: the object, about the origin [m].
        renderer: draws the picture.
        rng: where camera, pose, lights and background are drawn from.
        least: radius of the category's model, which has to lie before the camera, too [m].
    """
    radius = max(_radius(scene.bounds), least)
    camera = draw_camera(rng)
    pose = draw_pose(camera, radius, rng)
    picture = renderer.render(scene, camera, pose, lighting=draw_lighting(rng))
    pixels = picture.over(draw_backdrop(rng, camera.width, camera.height))
    if rng.random() < OCCLUDED:
        pixels = _occluded(pixels, picture.mask, camera, pose, radius, renderer, rng)
    return Observation(pixels, camera, pose)


def _occluded(
    pixels, mask: Bool[np.ndarray, "h w"], camera, pose, radius: float, renderer: Renderer, rng
) -> np.ndarray:
    """The picture with an occluder before the object's rim, unless it would hide too much or nothing."""
    thing = draw_random_object(rng)
    nearer = pose.copy()
    nearer[:3, 3] *= 0.75
    nearer[:2, 3] += rng.uniform(-radius, radius, 2)
    nearer[:3, :3] = towards(nearer[:3, 3])
    front = renderer.render(thing, camera, nearer, lighting=draw_lighting(rng))
    hidden = (front.mask & mask).sum() / max(mask.sum(), 1)
    return front.over(pixels) if HIDDEN[0] < hidden < HIDDEN[1] else pixels
