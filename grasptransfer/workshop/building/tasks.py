"""The tasks of a build that run in worker processes: arrays and settings in, plain arrays out."""

import io
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from grasptransfer.registration import DeformationField, Metric, PreparedSource, cpd
from grasptransfer.workshop.building.kept_tasks import Arrays
from grasptransfer.workshop.building.sources import prepare
from grasptransfer.workshop.building.space_fit import (
    Distances,
    InstanceFields,
    explained_variance,
    fit_space,
    fitted_error,
    leave_out,
    loosened,
)
from grasptransfer.workshop.building.surface_points import visible_surface, voxel_filter, voxel_for
from grasptransfer.workshop.building.writing import glb_of

# Numbers of points of an instance: to measure distances, to register the canonical model, to choose the
# canonical model, and to fit shape spaces.
DENSE_POINTS = 4000
TARGET_POINTS = 1000
COMPARED_POINTS = 250
FITTED_POINTS = 600


def prepare_instance(path: str, checksum: str, scale: float, rotation: np.ndarray) -> Arrays:
    """Read, check and repair one file; `checksum` is only there so that a changed file counts as new.

    Args:
        path: path of the file.
        checksum: checksum of the file's content.
        scale: metres in one unit of the file.
        rotation: (3, 3) from the file's axes to the category's.
    """
    prepared = prepare(Path(path), scale=scale, rotation=rotation)
    if prepared.cloud is None:
        points, _ = visible_surface(prepared.mesh)
    else:
        points = prepared.cloud
    return {
        "glb": np.frombuffer(glb_of(prepared.mesh), np.uint8),
        "points": thinned(points, DENSE_POINTS),
        "notes": np.array(prepared.notes or ("",)),
        "is_cloud": np.array(prepared.cloud is not None),
        "faces": np.array(len(prepared.mesh.faces)),
        "extents": prepared.mesh.extents,
    }


def compare_candidate(
    candidate: np.ndarray, others: tuple[np.ndarray, ...], beta: float, lam: float
) -> Arrays:
    """Register a candidate for the canonical model to all other instances.

    Args:
        candidate: (n, 3) its points [m].
        others: (m, 3) points of each [m].
    """
    chamfer, bend = [], []
    source = PreparedSource(candidate, beta=beta)
    for other in others:
        field = cpd(source, other, lam=lam, threads=1).field
        chamfer.append(Distances.between(field(candidate), other).chamfer)
        moved = field.displacement(candidate)
        bend.append(np.sqrt(np.square(moved).sum(1).mean()))
    return {"chamfer": np.array(chamfer), "moved": np.array(bend)}


def register_instance(
    control_points: np.ndarray,
    model: np.ndarray,
    instance: np.ndarray,
    beta: float,
    lam: float,
    outlier_weight: float,
    is_canonical: bool,
) -> Arrays:
    """CPD from the canonical model to one instance; to itself it is known to be the identity.

    Args:
        control_points: (n, 3) of the canonical model [m].
        model, instance: (m, 3) dense points to measure by [m].
    """
    if is_canonical:
        field, status = DeformationField.identity(control_points, beta=beta), "IDENTITY"
    else:
        target = thinned(instance, TARGET_POINTS)
        result = cpd(control_points, target, beta=beta, lam=lam, outlier_weight=outlier_weight, threads=1)
        field, status = result.field, result.status.name
    before, after = Distances.between(model, instance), Distances.between(field(model), instance)
    return {
        "weights": field.weights,
        "centre": field.centre,
        "scale": np.array(field.scale),
        "before": np.array([before.error, before.rms, before.chamfer]),
        "after": np.array([after.error, after.rms, after.chamfer]),
        "status": np.array(status),
    }


def judge(
    fields: InstanceFields,
    metric: Metric,
    tried: tuple[tuple[int, float], ...],
    left_out: tuple[int, ...],
    clouds: tuple[np.ndarray, ...],
) -> Arrays:
    """What shape spaces of several sizes leave of instances they never saw.

    Args:
        tried: numbers of modes, each with a flexibility.
        left_out: numbers of the instances to leave out, one at a time.
        clouds: (m, 3) points of each of them [m].
    """
    errors = [
        [
            fitted_error(
                leave_out(fields, index, n_modes=modes, flexibility=flexibility, metric=metric).space, cloud
            )
            for index, cloud in zip(left_out, clouds, strict=True)
        ]
        for modes, flexibility in tried
    ]
    return {"errors": np.array(errors)}


def learn(
    fields: InstanceFields,
    modes: int,
    flexibility: float,
    metric: Metric,
    model: np.ndarray,
    clouds: tuple[np.ndarray, ...],
) -> Arrays:
    """The shape space, and what it leaves of each instance that it did not see.

    Args:
        fields: fields of the train instances.
        modes: learnt; smooth ones come beside them with a flexibility above 0.
        model: dense points of the canonical model [m].
        clouds: (m, 3) dense points of each train instance, then of those the space never sees [m].
    """
    space = loosened(fit_space(fields, n_modes=modes, metric=metric), flexibility)
    alike = {"n_modes": min(modes, len(fields) - 2), "flexibility": flexibility, "metric": metric}
    without = [leave_out(fields, index, **alike) for index in range(len(fields))]
    spaces = [one.space for one in without] + [space] * (len(clouds) - len(fields))
    errors = [
        fitted_error(known, thinned(cloud, FITTED_POINTS), model=model, measured=cloud)
        for known, cloud in zip(spaces, clouds, strict=True)
    ]
    return {
        "mean": space.mean,
        "basis": space.basis,
        "variances": space.variances,
        "noise_variance": np.array(space.noise_variance),
        "explained": explained_variance(fields, metric=metric),
        "left_out_rms": np.array([one.rms for one in without]),
        "fitted_error": np.array(errors),
    }


def thinned(points: Float[np.ndarray, "m 3"], count: int) -> Float[np.ndarray, "n 3"]:
    """About `count` points, evenly spread; all where there are no more."""
    return points if len(points) <= count else points[voxel_filter(points, voxel_for(points, count))]


def mesh_of(glb: np.ndarray) -> trimesh.Trimesh:
    """The one mesh in a prepared instance's GLB."""
    scene = trimesh.load_scene(io.BytesIO(glb.tobytes()), file_type="glb", process=False)
    return next(iter(scene.geometry.values()))
