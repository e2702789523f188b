"""`bench calibration`: whether a grasp's score is its chance to hold, and the numbers that make it so.

Grasps that rgb transfers are executed on random shapes (neither train nor test instances) and, where folders
are given, on meshes and photographs of real objects (`executed_grasps.py`). The ranking's logistic models and
the experience with annotated grasps are fitted to what held (`chance_fit.py`). The score is judged as it is
now, as fitted to all objects, and with each object left out of the fit that scores it; the last is the honest
figure for an object that nobody has seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.category import load_category
from grasptransfer.errors import SettingsError
from grasptransfer.grasping.experience import Experience, write_experience
from grasptransfer.grasping.success_model import WEIGHTS, Ranking, write_ranking
from grasptransfer.options import GripperName, Protocol, check_counts
from grasptransfer.workshop.benchmark.chance_fit import (
    FittedScores,
    best_of_pictures,
    fit_chances,
    left_out_scores,
    log_loss,
)
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.executed_grasps import SOURCES, Executed, execute_on, found_objects
from grasptransfer.workshop.benchmark.given_poses import GivenPoses
from grasptransfer.workshop.benchmark.instance_pool import measure_instances
from grasptransfer.workshop.benchmark.options import (
    Categories,
    Meshes,
    Said,
    Together,
    Told,
    ViewsOfEach,
    name_trained,
)
from grasptransfer.workshop.benchmark.reliability import Chance, reliability_table, summarise_chances
from grasptransfer.workshop.benchmark.seen_instances import spread_views

PRESENT, FITTED, LEFT_OUT = "present", "fitted", "left_out"


@dataclass(frozen=True)
class CalibrationSettings:
    """What is measured.

    Photographs are given exact poses, said to be so or not, poses as estimators give them, and those on file.

    Args:
        objects: number of random shapes of each category.
        photos: folder with `photos.yaml`; none: no photographs.
        seed: seed of lights, backgrounds, pose errors and trials.
    """

    categories: Categories = ()
    objects: int = 12
    meshes: Meshes = None
    photos: Path | None = None
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
        """The given poses of rendered views and their uncertainty."""
        return GivenPoses.of(self.told, self.pose_sigma)


def run_calibration(
    settings: CalibrationSettings,
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    write: bool = False,
) -> dict:
    """Fitted numbers, and the reliability of the present, of the fitted and of the left-out score.

    Args:
        workers: processes.
        ledger: file that an interrupted run resumes from.
        write: the fitted numbers into `objects/models`, from which later processes take them.

    Raises:
        SettingsError: too few objects to leave some out.
    """
    if settings.objects < 2:
        raise SettingsError("must be at least 2", key="objects", value=settings.objects)
    spread_views(settings.views)  # This refuses a wrong number before the first picture.
    tasks = found_objects(settings.categories, settings.objects, settings.meshes, settings.photos)
    found = measure_instances(execute_on, settings, tasks, workers=workers, ledger=ledger, progress=progress)
    executed = [Executed.of(grasp) for one in found for grasp in one["grasps"]]
    fitted = fit_chances(executed)
    scores = {
        PRESENT: _present(settings.categories).scores(executed),
        FITTED: fitted.scores(executed),
        LEFT_OUT: left_out_scores(executed),
    }
    if write:
        _write(fitted, settings.categories)
    rows = [row for name in scores for row in _reliability(name, executed, scores[name])]
    summary: dict = {"grasps": len(executed), "objects": len({one.object for one in executed})}
    for name, given in scores.items():
        summary |= _summary(name, executed, given)
    summary |= {"shift": fitted.shift, "slope": fitted.slope}
    summary |= {name: float(value) for name, value in zip(WEIGHTS, fitted.weights, strict=True)}
    return document("calibration", settings=asdict(settings), rows=rows, summary=summary)


def _present(categories: tuple[str, ...]) -> FittedScores:
    """What is shipped now."""
    known = {name: Experience.of(load_category(name)) for name in categories}
    temperature = next(iter(known.values()))
    of_grasps = {f"{name}/{grasp}": value for name in known for grasp, value in known[name].of_grasps.items()}
    return FittedScores(Ranking.fitted().weights, temperature.shift, temperature.slope, of_grasps)


def _groups(executed: Sequence[Executed]) -> dict[str, list[int]]:
    """Numbers of the grasps of each source, and of each photographed object."""
    groups: dict[str, list[int]] = {}
    for number, one in enumerate(executed):
        groups.setdefault(one.source, []).append(number)
        if one.source == SOURCES[-1]:
            groups.setdefault(one.object.replace("/", "_"), []).append(number)
    return groups


def _reliability(name: str, executed: Sequence[Executed], scores: Float[np.ndarray, "g"]) -> list[dict]:
    """The share of held grasps beside the stated one: a table for each source."""
    rows = []
    for group, numbers in _groups(executed).items():
        chances = [Chance(float(scores[i]), executed[i].held) for i in numbers]
        rows += [{"scores": name, "of": group} | row for row in reliability_table(chances)]
    return rows


def _summary(name: str, executed: Sequence[Executed], scores: Float[np.ndarray, "g"]) -> dict:
    """The contract's keys for rgb under the present score; the others bear the name of theirs."""
    summary: dict = {f"log_loss_{name}": log_loss(executed, scores)}
    parts = {"": list(range(len(executed)))} | {f"_{k}": v for k, v in _groups(executed).items()}
    for part, numbers in parts.items():
        some, given = [executed[i] for i in numbers], scores[numbers]
        chances = [Chance(float(score), one.held) for score, one in zip(given, some, strict=True)]
        label = "rgb" if name == PRESENT else f"rgb_{name}"
        summary |= summarise_chances(f"{label}{part}", best_of_pictures(some, given), chances)
    return summary


def _write(fitted: FittedScores, categories: tuple[str, ...]) -> None:
    write_ranking(fitted.weights)
    of_categories: dict[str, dict[str, float]] = {name: {} for name in categories}
    for grasp, value in fitted.of_grasps.items():
        category, name = grasp.split("/")
        of_categories[category][name] = value
    canonicals = {name: load_category(name).canonical_sha256 for name in categories}
    temperature = (fitted.shift, fitted.slope)
    write_experience(temperature, of_categories, canonicals=canonicals)
