"""Fit what turns the signs of a picture into a verdict: to right inputs, and to wrong ones of every kind."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import GraspTransferError
from grasptransfer.perception.confidence import WRONG, PassWeights, PoseWeights, VerdictWeights
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.signs import OF_PASS, SIGNS, Signs
from grasptransfer.workshop import objects
from grasptransfer.workshop.training.pictures import picture_of, radius_of
from grasptransfer.workshop.training.random_objects import draw_random_object
from grasptransfer.workshop.training.training_shapes import (
    draw_training_shape,
    instances_of,
    training_canonical,
)
from grasptransfer.workshop.training.wrong_inputs import (
    Given,
    Pictured,
    foreign_object,
    right_inputs,
    without_object,
    wrong_cameras_and_boxes,
    wrong_poses,
)

CLASSES = (EstimateStatus.OK, *WRONG)
PHOTOGRAPHS = 0.3  # share of the weight of all inputs of a kind
RIDGE, PAIR_RIDGE = 3e-4, 3e-3  # on weights of signs in standard deviations
SAID_EXACT = 0.25  # share of the wrong inputs whose pose is said to be exact
EACH = 2  # wrong inputs of each kind that a picture gives, of all there are


@dataclass(frozen=True)
class Seen:
    """One input, and what its picture shows.

    Args:
        group: number of the picture that it came from.
        name: of the input.
        verdict: that it should get.
        photograph: whether the picture is no rendered one.
    """

    group: int
    name: str
    verdict: EstimateStatus
    signs: Signs
    photograph: bool = False


def fit_verdicts(seen: Sequence[Seen]) -> tuple[VerdictWeights, PassWeights, PoseWeights]:
    """Weights of `Confidence`: verdicts, preference by the first pass, and preference by all signs.

    Verdicts are a multinomial logistic regression: right inputs count half, each kind of wrong ones the same
    share of the rest, and photographs `PHOTOGRAPHS` of each kind, however many there are. Preferences are one
    on the difference between the right pose of a picture and a turned one.
    """
    signs = np.stack([one.signs for one in seen])
    kinds = np.array([CLASSES.index(one.verdict) for one in seen])
    weights = _logistic(signs, kinds, _shares(kinds, np.array([one.photograph for one in seen])))
    pairs = _differences(seen)
    return (weights[:, 1:] - weights[:, :1]).T, _preference(pairs[:, : len(OF_PASS)]), _preference(pairs)


def _shares(kinds: Int[np.ndarray, "m"], photographs: Bool[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """How much each input counts."""
    shares = np.zeros(len(kinds))
    wrong = len(set(kinds.tolist()) - {0})
    for kind in set(kinds.tolist()):
        groups = [(kinds == kind) & (photographs == flag) for flag in (False, True)]
        parts = np.array([1 - PHOTOGRAPHS, PHOTOGRAPHS]) * [group.any() for group in groups]
        for group, part in zip(groups, parts / parts.sum(), strict=True):
            shares[group] = part * (0.5 if kind == 0 else 0.5 / wrong) / max(group.sum(), 1)
    return shares


def _differences(seen: Sequence[Seen]) -> Float[np.ndarray, "m 23"]:
    """Signs of right poses minus those of turned ones, of the same picture and with a box as well or not."""
    right = {(one.group, one.name): one.signs for one in seen if one.verdict is EstimateStatus.OK}
    found = []
    for one in seen:
        same = right.get((one.group, "no box" if one.name.endswith("no box") else "box"))
        if one.verdict is EstimateStatus.POSE_TURNED and same is not None:
            found.append(same - one.signs)
    return np.array(found).reshape(-1, len(SIGNS))


def _preference(differences: Float[np.ndarray, "m t"]) -> Float[np.ndarray, "t"]:
    """Logistic regression without bias: which of two poses is the right one follows from their difference."""
    if not len(differences):
        return np.zeros(differences.shape[1])
    spread = np.sqrt(np.square(differences).mean(0)) + 1e-6
    rows = differences / spread

    def loss(weights):
        odds = rows @ weights
        slope = -(rows / (1 + np.exp(odds))[:, None]).mean(0) + 2 * PAIR_RIDGE * weights
        return np.logaddexp(0, -odds).mean() + PAIR_RIDGE * weights @ weights, slope

    return minimize(loss, np.zeros(rows.shape[1]), jac=True).x / spread


def _logistic(
    signs: Float[np.ndarray, "m 23"], kinds: Int[np.ndarray, "m"], share: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "24 6"]:
    """Weights of each kind, the bias first."""
    count = len(CLASSES)
    middle, spread = signs.mean(0), signs.std(0) + 1e-6
    rows = np.column_stack([np.ones(len(signs)), (signs - middle) / spread])
    chosen = np.eye(count)[kinds]

    def loss(flat):
        weights = flat.reshape(-1, count)
        odds = rows @ weights
        odds -= odds.max(1, keepdims=True)
        logs = odds - np.log(np.exp(odds).sum(1, keepdims=True))
        slope = rows.T @ ((np.exp(logs) - chosen) * share[:, None])
        slope[1:] += 2 * RIDGE * weights[1:]
        return -(share[:, None] * chosen * logs).sum() + RIDGE * np.square(weights[1:]).sum(), slope.ravel()

    start = np.zeros(rows.shape[1] * count)
    weights = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 3000}).x
    weights = weights.reshape(-1, count)
    weights[1:] /= spread[:, None]
    weights[0] -= middle @ weights[1:]
    return weights


def see_random_shapes(
    estimator: RgbEstimator, pictures: int, *, seed: int, progress: Callable[[], None] | None = None
) -> Iterator[Seen]:
    """Inputs made of pictures of random shapes: right ones, and some of each kind of wrong ones.

    Args:
        estimator: of the category.
        pictures: pictures of shapes of the category, and as many of strangers.
        seed: seed of shapes, pictures and inputs.
        progress: called after each picture.
    """
    canonical = training_canonical(estimator.category)
    instances = instances_of(estimator.category, held_out=True)
    rng = np.random.default_rng([seed, 6, *estimator.category.name.encode()])
    shapes = (draw_training_shape(canonical, instances, rng) for _ in range(pictures))
    drawn = ((shape.scene, shape.vertices) for shape in shapes)
    yield from _see(estimator, drawn, rng, progress=progress)


def see_photographs(estimator: RgbEstimator, photographs: Iterable[Pictured], *, seed: int) -> Iterator[Seen]:
    """The same with photographs of objects of the category."""
    rng = np.random.default_rng([seed, 8, *estimator.category.name.encode()])
    for number, seen in enumerate(photographs):
        wrong = [*wrong_poses(seen, estimator.category, rng), *wrong_cameras_and_boxes(seen, rng)]
        inputs = [*right_inputs(seen, rng), *_some_of_each(wrong, rng)]
        for one in assess_all(estimator, inputs, number):
            yield replace(one, photograph=True)


def _see(
    estimator: RgbEstimator,
    drawn: Iterable[tuple[trimesh.Scene | trimesh.Trimesh, np.ndarray]],
    rng: np.random.Generator,
    *,
    progress: Callable[[], None] | None = None,
) -> Iterator[Seen]:
    category = estimator.category
    least = radius_of(category.canonical.bounds)
    strangers = draw_strangers(category.name, rng)
    with Renderer() as renderer:
        for number, (scene, points) in enumerate(drawn):
            seen = picture_of(scene, points, renderer, rng, least=least)
            other, name = next(strangers)
            foreign = picture_of(other, np.asarray(_solid(other).vertices), renderer, rng, least=least)
            wrong = [
                *without_object(seen, rng),
                *foreign_object(foreign, name, rng),
                *wrong_poses(seen, category, rng),
                *wrong_cameras_and_boxes(seen, rng),
            ]
            yield from assess_all(estimator, [*right_inputs(seen, rng), *_some_of_each(wrong, rng)], number)
            if progress:
                progress()


def assess_all(estimator: RgbEstimator, inputs: Iterable[Given], group: int) -> Iterator[Seen]:
    """What the estimator sees of inputs; those that are refused at once need no verdict."""
    for given in inputs:
        try:
            signs = estimator.assess(given.observation())[1]
        except GraspTransferError:
            continue
        yield Seen(group, given.name, given.verdict, signs)


def draw_strangers(name: str, rng: np.random.Generator) -> Iterator[tuple[trimesh.Scene, str]]:
    """Objects of the other categories and objects of none, in turn, each with what it is."""
    others = [other for other in objects.generators() if other != name]
    for other in chain.from_iterable([others] * 10**6):
        yield objects.sample(other, int(rng.integers(2**31))).scene(), "object of another category"
        yield draw_random_object(rng), "object of no category"


def _some_of_each(wrong: Sequence[Given], rng: np.random.Generator) -> Iterator[Given]:
    order = sorted((one for one in wrong if one.fitted), key=lambda one: one.verdict.value)
    for _, group in groupby(order, key=lambda one: one.verdict):
        kinds = list(group)
        for index in rng.permutation(len(kinds))[:EACH]:
            exact = {"pose_sigma": 0} if rng.random() < SAID_EXACT else {}
            yield replace(kinds[index], arguments=kinds[index].arguments | exact)


def _solid(mesh: trimesh.Scene | trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
