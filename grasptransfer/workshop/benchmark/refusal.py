"""`bench refusal`: how often an estimator accepts objects of other categories, and refuses its own."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from grasptransfer.category import Category, load_category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.options import check_counts
from grasptransfer.perception.estimate import EstimateStatus
from grasptransfer.perception.estimators import EstimatorSettings, make_estimator
from grasptransfer.registration import DeformationField
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.options import Categories, ViewsOfEach, name_trained
from grasptransfer.workshop.benchmark.seen_instances import (
    Instance,
    instances,
    observe_instance,
    spread_views,
)
from grasptransfer.workshop.training.dataset import OF_NO_CATEGORY as RANDOM
from grasptransfer.workshop.training.random_objects import draw_random_object


@dataclass(frozen=True)
class RefusalSettings:
    """What is measured.

    Args:
        categories: each one's estimator sees the test instances of all; none given: all that have weights.
        random_objects: objects of no category beside them.
        seed: seed of random objects, lights and backgrounds.
    """

    categories: Categories = ()
    views: ViewsOfEach = 4
    random_objects: int = 12
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self)


def run_refusal_benchmark(
    settings: RefusalSettings, *, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Scores of every estimator on every object, with the true pose and the object's box given."""
    viewpoints = spread_views(settings.views)
    rows: list[dict] = []
    with Renderer() as renderer:
        for done, name in enumerate(settings.categories, 1):
            category = load_category(name)
            made_with = EstimatorSettings(refine_pose=False, masks_for_depth_alone=True)
            estimator = make_estimator("rgb", category, made_with)
            for shown, instance in _objects(settings, category):
                rows += [
                    _look(estimator, instance, viewpoint, settings.seed, renderer)
                    | {"category": name, "shown": shown, "view": view}
                    for view, viewpoint in enumerate(viewpoints)
                ]
            if progress:
                progress(done, len(settings.categories))
    return document("refusal", settings=asdict(settings), rows=rows, summary=summarise(rows))


def summarise(rows: list[dict]) -> dict:
    """False refusals and false acceptances, and how well the score separates own objects from others."""
    own = [row for row in rows if row["shown"] == row["category"]]
    other = [row for row in rows if row["shown"] not in (row["category"], RANDOM)]
    random = [row for row in rows if row["shown"] == RANDOM]
    summary = {
        "own": len(own),
        "false_refusals": 1 - _accepted(own),
        "of_other_categories": len(other),
        "false_acceptances_other": _accepted(other),
        "random_objects": len(random),
        "false_acceptances_random": _accepted(random),
        "separation": _separation(own, other + random),
    }
    for name in sorted({row["category"] for row in rows}):
        summary[f"false_refusals_{name}"] = 1 - _accepted([row for row in own if row["category"] == name])
        strangers = [row for row in other + random if row["category"] == name]
        summary[f"false_acceptances_{name}"] = _accepted(strangers)
    return summary


def _objects(settings: RefusalSettings, category: Category) -> Iterator[tuple[str, Instance]]:
    """What is shown, as if it were an instance of `category`."""
    for instance in instances(list(settings.categories), None):
        yield instance.category.name, replace(instance, category=category)
    still = DeformationField.identity(category.shape_space.control_points)
    for index in range(settings.random_objects):
        mesh = draw_random_object(np.random.default_rng([settings.seed, 7, index]))
        yield RANDOM, Instance(category, f"random {index}", mesh, still)


def _look(estimator, instance, viewpoint: int, seed: int, renderer: Renderer) -> dict:
    observation, _ = observe_instance(instance, viewpoint, renderer=renderer, seed=seed)
    estimate = estimator(observation)
    accepted = estimate.status is not EstimateStatus.OUT_OF_CATEGORY
    return {
        "instance": instance.name,
        "score": estimate.category_score,
        "accepted": bool(accepted),
    }


def _accepted(rows: list[dict]) -> float:
    return float(np.mean([row["accepted"] for row in rows])) if rows else float("nan")


def _separation(own: list[dict], strangers: list[dict]) -> float:
    """Share of pairs in which the own object scores higher (the area under the ROC curve)."""
    ours = np.array([row["score"] for row in own])[:, None]
    theirs = np.array([row["score"] for row in strangers])[None]
    return float(((ours > theirs) + 0.5 * (ours == theirs)).mean()) if ours.size and theirs.size else np.nan
