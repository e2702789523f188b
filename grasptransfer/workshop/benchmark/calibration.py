"""`bench calibration`: whether a grasp's score is its chance to hold, and the weights that make it so.

Grasps that rgb transfers to random parametric shapes (neither train nor test instances) are executed in
PyBullet; the ranking's logistic models are fitted to what held. Half of the shapes fit, the other half judge.
"""

import itertools
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.grasping import load_gripper
from grasptransfer.grasping.ranking import grasp_features
from grasptransfer.grasping.success_model import (
    WEIGHTS,
    Features,
    Ranking,
    Weights,
    expected_success,
    write_ranking,
)
from grasptransfer.options import GripperName, Protocol, check_counts
from grasptransfer.perception.estimators import EstimatorSettings, make_estimator
from grasptransfer.simulation import simulate
from grasptransfer.transfer import GraspTransfer
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.given_poses import GivenPoses
from grasptransfer.workshop.benchmark.grasp import as_executed
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import (
    Categories,
    Said,
    Together,
    Told,
    ViewsOfEach,
    name_trained,
)
from grasptransfer.workshop.benchmark.seen_instances import (
    load_instance,
    observe_instance,
    random_names,
    spread_views,
    viewpoints_of,
)

MOST_GRASPS = 8  # At most so many grasps of one picture are executed.
FIRST_SEED = 78_000_000  # Seeds of the random shapes, far from those of train and test instances.
BINS = (0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0)
RIDGE = 0.02  # Keeps weights for which few grasps are evidence near the present ones.


@dataclass(frozen=True)
class CalibrationSettings:
    """What is measured.

    Args:
        objects: number of random shapes of each category.
        seed: seed of lights, backgrounds, pose errors and trials.
    """

    categories: Categories = ()
    objects: int = 12
    views: ViewsOfEach = 3
    views_together: Together = 1
    told: Told = "estimator"
    pose_sigma: Said = ()
    gripper: GripperName = "panda"
    protocol: Protocol = "lift-shake-v1"
    seed: int = 0

    def __post_init__(self):
        name_trained(self)
        check_counts(self, "views_together")
        _ = self.given

    @property
    def given(self) -> GivenPoses:
        """The given poses and their uncertainty."""
        return GivenPoses.of(self.told, self.pose_sigma)


@dataclass(frozen=True)
class Executed:
    """Features of one executed grasp in each drawn sample of the estimate, and whether the grasp held."""

    features: Features
    held: bool


def run_calibration(
    settings: CalibrationSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    write: bool = False,
) -> dict:
    """Fitted weights, and the reliability of the present and of the fitted score.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.
        write: the fitted weights into `objects/models/ranking.yaml`, from which later processes take them.

    Raises:
        SettingsError: too few objects to fit with one half and judge by the other.
    """
    if settings.objects < 2:
        raise SettingsError("must be at least 2", key="objects", value=settings.objects)
    spread_views(settings.views)  # This refuses a wrong number before the first picture.
    names = random_names(settings.objects, FIRST_SEED)
    tasks = [(category, name) for category in settings.categories for name in names]
    found = measure_instances(_execute_on, settings, tasks, workers=workers, ledger=ledger, progress=progress)
    executed = {
        task: [Executed(np.array(grasp["features"], float), grasp["held"]) for grasp in one["grasps"]]
        for task, one in zip(tasks, found, strict=True)
    }
    even = [grasp for task in tasks if task[1] in names[::2] for grasp in executed[task]]
    odd = [grasp for task in tasks if task[1] in names[1::2] for grasp in executed[task]]
    present, fitted = Ranking.fitted().weights, fit_weights([*even, *odd])
    crossed = [(fit_weights(odd), even), (fit_weights(even), odd)]
    scores = [(float(expected_success(g.features, w)), g.held) for w, group in crossed for g in group]
    now = [(float(expected_success(g.features, present)), g.held) for g in [*even, *odd]]
    if write:
        write_ranking(fitted)
    rows = reliability(now, "present")
    rows += reliability(scores, "fitted")
    summary = {"grasps": len(scores), "held": float(np.mean([held for _, held in scores]))}
    for name in ("present", "fitted"):
        summary[f"calibration_error_{name}"] = calibration_error(rows, name)
    summary |= {name: float(value) for name, value in zip(WEIGHTS, fitted, strict=True)}
    return document("calibration", settings=asdict(settings), rows=rows, summary=summary)


def fit_weights(executed: list[Executed]) -> Weights:
    """The ranking's weights under which the observed outcomes are most likely."""
    from scipy.optimize import minimize

    start = Ranking.fitted().weights
    held = np.array([grasp.held for grasp in executed])
    features = np.stack([grasp.features for grasp in executed])

    def loss(weights):
        chance = np.clip(expected_success(features, weights), 1e-3, 1 - 1e-3)
        likelihood = np.where(held, np.log(chance), np.log(1 - chance)).mean()
        return -likelihood + RIDGE * np.square((weights - start) / np.abs(start)).mean()

    return minimize(loss, start, method="Nelder-Mead", options={"maxiter": 2000, "xatol": 1e-3}).x


def reliability(scores: list[tuple[float, bool]], name: str) -> list[dict]:
    """The share of held grasps in each range of scores."""
    values, held = np.array([score for score, _ in scores]), np.array([held for _, held in scores])
    rows = []
    for low, high in itertools.pairwise(BINS):
        chosen = (values >= low) & (values < high if high < 1 else values <= high)
        if chosen.any():
            means = {"score": float(values[chosen].mean()), "held": float(held[chosen].mean())}
            rows.append({"weights": name, "from": low, "to": high, "grasps": int(chosen.sum()), **means})
    return rows


def calibration_error(rows: list[dict], name: str) -> float:
    """Mean distance between score and share held, over all grasps."""
    chosen = [row for row in rows if row["weights"] == name]
    grasps = sum(row["grasps"] for row in chosen)
    return sum(row["grasps"] * abs(row["score"] - row["held"]) for row in chosen) / max(grasps, 1)


def _execute_on(settings: CalibrationSettings, category: str, name: str) -> dict:
    """`grasps` on one random shape: features in each draw, and whether each held."""
    instance, gripper = load_instance(category, name), load_gripper(settings.gripper)
    executed: list[Executed] = []
    estimator = make_estimator("rgb", instance.category, EstimatorSettings(masks_for_depth_alone=True))
    flow = GraspTransfer(instance.category, gripper=gripper, estimator=estimator)
    with Renderer() as renderer:
        for viewpoint in viewpoints_of(name, settings.views):
            observation, pose = observe_instance(
                instance,
                viewpoint,
                renderer=renderer,
                noise=settings.given,
                seed=settings.seed,
                pictures=settings.views_together,
            )
            executed += _execute(flow, observation, pose, instance, settings)
    return {"grasps": [{"features": one.features.tolist(), "held": one.held} for one in executed]}


def _execute(flow: GraspTransfer, observation, pose, instance, settings) -> list[Executed]:
    estimate = flow.estimator(observation)
    planned = flow.plan(estimate)
    features = grasp_features(planned.grasps, planned.checks, flow.gripper, plausible=planned.plausible)
    usable = np.array([i for i, check in enumerate(planned.checks) if check.usable], int)
    rng = np.random.default_rng(settings.seed)
    usable = rng.permutation(usable)[:MOST_GRASPS]  # Many members of a symmetry family are alike.
    chosen = [planned.grasps[i] for i in usable]
    placed = as_executed(chosen, estimated_pose=estimate.camera_from_object, true_pose=pose)
    density = instance.category.density  # which the scores assume, too
    trials = simulate(
        placed,
        instance.solid,
        flow.gripper,
        protocol=settings.protocol,
        density=density,
        seed=settings.seed,
    )
    return [
        Executed(features[i], trial.status.name == "HELD") for i, trial in zip(usable, trials, strict=True)
    ]
