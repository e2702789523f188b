"""Fit `Confidence` to a trained network: on held-out shapes, and on wrong inputs of every kind."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.category import Category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.perception.confidence import Confidence
from grasptransfer.perception.observation import observe
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.weights import load_weights, write_confidence
from grasptransfer.workshop.training.pictures import picture_of, radius_of
from grasptransfer.workshop.training.training_shapes import (
    draw_training_shape,
    instances_of,
    training_canonical,
)
from grasptransfer.workshop.training.verdict_fit import fit_verdicts, see_random_shapes

INTERVAL = 0.9
NORMAL_90 = 1.645  # standard deviations on either side that hold 90 % of a normal distribution


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
        pictures: pictures of held-out shapes (`training_shapes.instances_of`) of each category, for the
            latent's errors, and as many for the verdicts.
        seed: seed of shapes, pictures and inputs.
        progress: called with (pictures done, in all).
    """
    confidence = load_weights(weights)[1].confidence
    done, total = 0, 2 * pictures * len(categories)

    def step():
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    seen, errors = [], []
    for number, category in enumerate(categories):
        estimator = RgbEstimator(category, weights=weights)
        estimator.confidence = replace(confidence, overconfidence=1.0)
        for error in _latent_errors(estimator, pictures, np.random.default_rng([seed, 5, number])):
            errors.append(error)
            step()
        seen += see_random_shapes(estimator, pictures, seed=seed, progress=step)
    verdicts, of_pass, of_pose = fit_verdicts(seen)
    confidence = replace(
        confidence,
        verdicts=verdicts,
        of_pass=of_pass,
        of_pose=of_pose,
        overconfidence=fit_overconfidence(errors),
    )
    write_confidence(weights, confidence)
    return load_weights(weights)[1].confidence


def fit_overconfidence(errors: Sequence[Float[np.ndarray, "_"]]) -> float:
    """The factor on the squared deviations with which 90 % intervals hold the truth in 90 % of the cases.

    Args:
        errors: of the latents of several pictures over their stated deviations.
    """
    spread = np.quantile(np.abs(np.concatenate(errors)), INTERVAL) / NORMAL_90
    return float(max(spread, 1.0) ** 2)


def _latent_errors(
    estimator: RgbEstimator, pictures: int, rng: np.random.Generator
) -> Iterator[Float[np.ndarray, "_"]]:
    """Errors over stated deviations, with the true pose and no box, the covariance not widened yet."""
    category = estimator.category
    canonical, instances = training_canonical(category), instances_of(category, held_out=True)
    least = radius_of(category.canonical.bounds)
    with Renderer() as renderer:
        for _ in range(pictures):
            shape = draw_training_shape(canonical, instances, rng)
            seen = picture_of(shape.scene, shape.vertices, renderer, rng, least=least)
            estimate = estimator(observe(seen.image, seen.pose, camera=seen.camera, pose_sigma=0))
            assert estimate.latent is not None
            assert estimate.latent_covariance is not None
            known = len(shape.latent)
            deviations = np.sqrt(np.diag(estimate.latent_covariance))[:known]
            yield (estimate.latent[:known] - shape.latent) / deviations
