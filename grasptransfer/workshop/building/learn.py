"""What the prepared instances teach: canonical model, registrations, settings and shape space."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from grasptransfer.registration import Metric, ShapeSpace
from grasptransfer.workshop.building.choices import (
    Canonical,
    Chosen,
    choose_canonical,
    choose_settings,
    fields_of,
    register,
)
from grasptransfer.workshop.building.kept_tasks import Arrays, Workshop
from grasptransfer.workshop.building.orientation import agreed_turn
from grasptransfer.workshop.building.outcome import Candidate, Registration, Trial
from grasptransfer.workshop.building.settings import BuildSettings
from grasptransfer.workshop.building.space_fit import Distances, InstanceFields
from grasptransfer.workshop.building.surface_points import visible_surface, voxel_filter, voxel_for
from grasptransfer.workshop.building.tasks import COMPARED_POINTS, learn, mesh_of, thinned


@dataclass(frozen=True)
class LearntCategory:
    """All of a category but its files.

    Args:
        canonical: name of the instance that is the canonical model.
        candidates, trials, registrations, explained: as of `CategoryBuild`.
        chosen: settings of the registrations and the shape space.
        space: shape space of the train instances.
        voxel: edge of the filter that left the control points [m].
        weights: (n, 3) of each instance's field, normalised units, by name.
    """

    canonical: str
    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    registrations: tuple[Registration, ...]
    explained: Float[np.ndarray, "k"]
    chosen: Chosen
    space: ShapeSpace
    voxel: float
    weights: dict[str, Float[np.ndarray, "n 3"]]


def learn_category(
    workshop: Workshop,
    prepared: dict[str, Arrays],
    split: dict[str, bool],
    *,
    settings: BuildSettings,
) -> LearntCategory:
    """Choose the canonical model and the settings, register it to every instance, learn the shape space.

    Args:
        prepared: instances by name, as of `prepare_instance`.
        split: whether each is a test instance.
        settings: what is given; the rest is chosen.
    """
    train = {one: arrays for one, arrays in prepared.items() if not split[one]}
    candidates: tuple[Candidate, ...] = ()
    canonical = settings.canonical
    if canonical is None:
        candidates = choose_canonical(workshop, train, settings)
        canonical = candidates[0].name
    model = _canonical(canonical, prepared[canonical], settings.control_points)
    how = {"kernels": settings.kernels(), "outlier_weight": settings.outlier_weight}
    registered = register(workshop, train, model, **how)
    chosen, trials = choose_settings(workshop, train, registered, model.control_points, settings)
    how["kernels"] = [(chosen.beta, chosen.lam)]
    found = register(workshop, prepared, model, **how)
    fields = fields_of(train, found, model.control_points, chosen.beta, chosen.lam)
    # Train instances come first.
    clouds = {one: prepared[one]["points"] for one in sorted(prepared, key=split.__getitem__)}
    learnt, space = _learn(workshop, fields, clouds, model=model, chosen=chosen, metric=settings.metric)
    registered = {one: arrays for (one, _, _), arrays in found.items()}
    return LearntCategory(
        canonical=canonical,
        candidates=candidates,
        trials=trials,
        registrations=_registrations(split, prepared, registered, learnt, canonical),
        explained=learnt["explained"],
        chosen=chosen,
        space=space,
        voxel=model.voxel,
        weights={one: arrays["weights"] for one, arrays in registered.items()},
    )


def _canonical(name: str, model: Arrays, count: int) -> Canonical:
    """The canonical model with about `count` control points."""
    points = model["points"] if model["is_cloud"] else visible_surface(mesh_of(model["glb"]))[0]
    voxel = voxel_for(points, min(count, len(points)))
    return Canonical(name, points[voxel_filter(points, voxel)], voxel, model["points"])


def _learn(
    workshop: Workshop,
    fields: InstanceFields,
    clouds: dict[str, Float[np.ndarray, "_ 3"]],
    *,
    model: Canonical,
    chosen: Chosen,
    metric: Metric,
) -> tuple[dict[str, Any], ShapeSpace]:
    """Final shape space, and what was measured with it; clouds are of the train instances first."""
    given = {
        "fields": fields,
        "modes": chosen.modes,
        "flexibility": chosen.flexibility,
        "metric": metric,
        "model": model.points,
        "clouds": tuple(clouds.values()),
    }
    learnt = workshop.map("learn", learn, {"shape_space": given})["shape_space"]
    errors = dict(zip(clouds, learnt.pop("fitted_error"), strict=True))
    normaliser = (fields.centre, fields.scale)
    found = (learnt["mean"], learnt["basis"], learnt["variances"], float(learnt["noise_variance"]))
    space = ShapeSpace(fields.control_points, chosen.beta, *normaliser, *found, metric)
    return {**learnt, "fitted_error": errors}, space


def _registrations(
    split: dict[str, bool], prepared, registered, learnt, canonical: str
) -> tuple[Registration, ...]:
    small = {name: thinned(arrays["points"], COMPARED_POINTS) for name, arrays in prepared.items()}
    train = [name for name, test in split.items() if not test]
    found = []
    for name, test in split.items():
        arrays, result = prepared[name], registered[name]
        number = None if test else train.index(name)
        found.append(
            Registration(
                name=name,
                test=test,
                is_cloud=bool(arrays["is_cloud"]),
                faces=int(arrays["faces"]),
                extents=arrays["extents"],
                notes=tuple(str(note) for note in arrays["notes"] if note),
                turn=agreed_turn(small[canonical], small[name], [small[one] for one in train if one != name]),
                points=arrays["points"],
                before=Distances(*(float(number) for number in result["before"])),
                after=Distances(*(float(number) for number in result["after"])),
                status=str(result["status"]),
                fitted_error=float(learnt["fitted_error"][name]),
                left_out_rms=None if number is None else float(learnt["left_out_rms"][number]),
            )
        )
    return tuple(found)
