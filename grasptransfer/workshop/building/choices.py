"""What a build chooses by measuring: the canonical model, then the settings of its shape space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from grasptransfer.registration import Metric
from grasptransfer.workshop.building.kept_tasks import Arrays, Workshop
from grasptransfer.workshop.building.outcome import Candidate, Trial
from grasptransfer.workshop.building.settings import BuildSettings
from grasptransfer.workshop.building.space_fit import InstanceFields
from grasptransfer.workshop.building.tasks import (
    COMPARED_POINTS,
    FITTED_POINTS,
    compare_candidate,
    judge,
    register_instance,
    thinned,
)

MODES = (1, 2, 3, 5, 8, 12, 18, 25)
FLEXIBILITIES = (0.02, 0.04, 0.08)
# Choices whose error is at most 2 % above the least count as equal: then the least displacement, the fewest
# modes and the tightest space decide.
TOLERANCE = 1.02
LEFT_OUT = 12  # Settings are judged by at most so many instances, evenly picked.


@dataclass(frozen=True, eq=False)
class Canonical:
    """The instance that is the canonical model, as points.

    Args:
        name: name of the instance.
        control_points: (n, 3) points that carry every field [m].
        voxel: edge of the voxel filter that left the control points [m].
        points: (p, 3) dense ones, to measure by [m].
    """

    name: str
    control_points: Float[np.ndarray, "n 3"]
    voxel: float
    points: Float[np.ndarray, "p 3"]


@dataclass(frozen=True)
class Chosen:
    """What `Options` leaves open, given or chosen; attributes as there."""

    beta: float
    lam: float
    modes: int
    flexibility: float


def choose_canonical(
    workshop: Workshop, train: dict[str, Arrays], settings: BuildSettings
) -> tuple[Candidate, ...]:
    """Every train instance registered to every other, best first.

    Args:
        train: instances by name, as of `tasks.prepare_instance`.
        settings: beta and lambda of the registrations.
    """
    small = {name: thinned(arrays["points"], COMPARED_POINTS) for name, arrays in train.items()}
    given = {
        name: {
            "candidate": small[name],
            "others": tuple(small[other] for other in train if other != name),
            "beta": settings.first_beta,
            "lam": settings.first_lam,
        }
        for name in train
    }
    compared = workshop.map("choose canonical", compare_candidate, given)
    candidates = [
        Candidate(
            name,
            float(arrays["chamfer"].mean()),
            float(arrays["chamfer"].max()),
            float(arrays["moved"].mean()),
            bool(train[name]["is_cloud"]),
        )
        for name, arrays in compared.items()
    ]
    return ranked(candidates)


def ranked(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Meshes before clouds; of those that leave about the least, what moves least: the most typical one."""
    kind = [one for one in candidates if not one.is_cloud] or candidates
    enough = TOLERANCE * min(one.chamfer for one in kind)

    def place(one: Candidate):
        near = one.chamfer <= enough
        return one.is_cloud, not near, one.moved if near else one.chamfer, one.name

    return tuple(sorted(candidates, key=place))


def register(
    workshop: Workshop,
    instances: dict[str, Arrays],
    canonical: Canonical,
    *,
    kernels: list[tuple[float, float]],
    outlier_weight: float,
) -> dict[tuple[str, float, float], Arrays]:
    """CPD from the canonical model to every instance, with several beta and lambda.

    Args:
        instances: by name, as of `tasks.prepare_instance`.
        kernels: every beta with its lambda.
        outlier_weight: outlier weight of CPD, in [0, 1).

    Returns:
        What `tasks.register_instance` found, by name, beta and lambda.
    """
    given, keys = {}, {}
    for beta, lam in kernels:
        for name, arrays in instances.items():
            keys[f"{name}-{beta:g}-{lam:g}"] = (name, beta, lam)
            given[f"{name}-{beta:g}-{lam:g}"] = {
                "control_points": canonical.control_points,
                "model": canonical.points,
                "instance": arrays["points"],
                "beta": beta,
                "lam": lam,
                "outlier_weight": outlier_weight,
                "is_canonical": name == canonical.name,
            }
    found = workshop.map("register", register_instance, given)
    return {keys[text]: arrays for text, arrays in found.items()}


def choose_settings(
    workshop: Workshop,
    train: dict[str, Arrays],
    registered: dict[tuple[str, float, float], Arrays],
    control: Float[np.ndarray, "n 3"],
    settings: BuildSettings,
) -> tuple[Chosen, tuple[Trial, ...]]:
    """Leave instances out in turn and fit the shape space of the others to their points, as one sees them.

    Args:
        train: instances by name, as of `tasks.prepare_instance`.
        registered: as of `register`, with every kernel of `settings`.
        control: (n, 3) control points of the canonical model [m].
        settings: what is given; the rest is chosen.

    Returns:
        chosen: the settings.
        trials: all that was measured; nothing where all settings were given.
    """
    beta, lam, count, flexibility = settings.beta, settings.lam, settings.modes, settings.flexibility
    if beta is not None and lam is not None and count is not None and flexibility is not None:
        return Chosen(beta, lam, count, flexibility), ()
    most = len(train) - 2  # A space without one instance has at most so many modes.
    tried = (
        {n for n in (*MODES, most) if n <= most} if settings.modes is None else {min(settings.modes, most)}
    )
    first = settings.flexibility or 0.0
    judged = _Judged(workshop, train, registered, control, settings.metric)
    trials = judged(settings.kernels(), [(modes, first) for modes in sorted(tried)])
    best = best_trial(trials)
    if settings.flexibility is None:
        trials += judged(settings.kernels(), [(best.modes, more) for more in FLEXIBILITIES])
        best = best_trial([one for one in trials if one.modes == best.modes])
    # Where as many modes as can be tried are best, all instances together give one more.
    modes = settings.modes or (best.modes + 1 if best.modes == most else best.modes)
    return Chosen(best.beta, best.lam, modes, best.flexibility), trials


@dataclass(frozen=True)
class _Judged:
    """Leaves instances out and measures what spaces of the others leave of their points."""

    workshop: Workshop
    train: dict[str, Arrays]
    registered: dict[tuple[str, float, float], Arrays]
    control: Float[np.ndarray, "n 3"]
    metric: Metric

    def __call__(
        self, kernels: list[tuple[float, float]], tried: list[tuple[int, float]]
    ) -> tuple[Trial, ...]:
        names = list(self.train)
        left_out = np.unique(np.linspace(0, len(names) - 1, LEFT_OUT).round().astype(int))
        clouds = tuple(thinned(self.train[names[index]]["points"], FITTED_POINTS) for index in left_out)
        given = {}
        for beta, lam in kernels:
            fields = fields_of(self.train, self.registered, self.control, beta, lam)
            given[f"beta {beta:g}, lambda {lam:g}"] = {
                "fields": fields,
                "metric": self.metric,
                "tried": tuple(tried),
                "left_out": tuple(left_out.tolist()),
                "clouds": clouds,
            }
        judged = self.workshop.map("choose settings", judge, given)
        return tuple(
            Trial(beta, lam, *sizes, float(errors.mean()))
            for (beta, lam), arrays in zip(kernels, judged.values(), strict=True)
            for sizes, errors in zip(tried, arrays["errors"], strict=True)
        )


def best_trial(trials: Sequence[Trial]) -> Trial:
    """The least error; of that kernel and smoothness, the tightest space that comes near it."""
    least = min(trials, key=lambda one: one.error)
    same = [one for one in trials if (one.beta, one.lam) == (least.beta, least.lam)]
    near = [one for one in same if one.error <= TOLERANCE * least.error]
    return min(near, key=lambda one: (one.flexibility, one.modes))


def fields_of(
    train: dict[str, Arrays],
    registered: dict[tuple[str, float, float], Arrays],
    control: Float[np.ndarray, "n 3"],
    beta: float,
    lam: float,
) -> InstanceFields:
    """The registered fields of all train instances.

    Args:
        train: train instances by name.
        registered: what `register` found.
        control: (n, 3) control points of the canonical model [m].
        beta: kernel width of the fields to take, normalised units.
        lam: lambda of the fields to take.
    """
    first = registered[next(iter(train)), beta, lam]
    weights = np.stack([registered[name, beta, lam]["weights"] for name in train])
    return InstanceFields(weights, control, beta, first["centre"], float(first["scale"]))
