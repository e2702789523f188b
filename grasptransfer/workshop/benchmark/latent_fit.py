"""Shape space and pose fitted to whole clouds: `latent_fit` against its predecessor's objective.

All fit the same shape space to the same clouds and take turns. The predecessor squares the distance of
each observed point to its nearest model point, without prior, with derivatives from differences, and
multiplies G W at each step (Rodriguez and Behnke 2018; their published code gives the details). So that
it is not judged by its arithmetic alone, the same idea also runs with what we know: plain distances, a
k-d tree, and the displacement model.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, median
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from tyro.conf import arg

from grasptransfer.errors import CategoryError
from grasptransfer.jobs import single_blas_thread
from grasptransfer.registration import Matching, PreparedSource, ShapeSpace, cpd_all, latent_fit
from grasptransfer.registration.clouds import check_cloud
from grasptransfer.registration.kernels import gaussian
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.options import Repeats
from grasptransfer.workshop.building.cloud_files import read_pcd, read_xyz
from grasptransfer.workshop.building.sources import find_sources

READERS = {".pcd": read_pcd, ".xyz": read_xyz}
FEWEST_TRAINING = 3


@dataclass(frozen=True)
class LatentFitSettings:
    """What `run_latent_fit_benchmark` does.

    Args:
        data: folder of clouds (pcd, xyz) in one frame [m]: `train/` and `test/`.
        n_modes: k of the shape space.
        beta: kernel width of CPD, normalised units.
        lam: lambda of CPD.
    """

    data: Path
    n_modes: Annotated[int, arg(name="modes")] = 5
    beta: float = 1.0
    lam: float = 2.0
    repeats: Repeats = 3


def run_latent_fit_benchmark(
    settings: LatentFitSettings, *, progress: Callable[[int, int], None] | None = None
) -> dict:
    """Fit each test cloud with each method, with the pose kept and with the pose refined.

    Raises:
        CategoryError: no clouds, other files than clouds, or too few to train or test.
    """
    train, test = _read(settings)
    canonical = _most_central(train)
    space = _learn(train, canonical, settings)
    rows: list[dict] = []
    with single_blas_thread():
        for done, (name, cloud) in enumerate(test.items(), 1):
            for pose in ("kept", "refined"):
                rows += _compare(space, name, cloud, pose, settings.repeats)
            if progress:
                progress(done, len(test))
    return document(
        "latent-fit", settings={**asdict(settings), "canonical": canonical}, rows=rows, summary=_summary(rows)
    )


def _compare(
    space: ShapeSpace, name: str, cloud: Float[np.ndarray, "m 3"], pose: str, repeats: int
) -> list[dict]:
    """One row for each method; they take turns."""
    seconds: dict[str, list[float]] = {method: [] for method in METHODS}
    errors: dict[str, float] = {}
    for _ in range(repeats):
        for method, fit in METHODS.items():
            start = time.perf_counter()
            moved = fit(space, cloud, pose == "refined")
            seconds[method].append(time.perf_counter() - start)
            errors[method] = float(np.square(KDTree(moved).query(cloud)[0]).mean() * 1e6)
    return [
        {
            "instance": name,
            "pose": pose,
            "method": method,
            "seconds": median(seconds[method]),
            "E": errors[method],
            "rms_mm": float(np.sqrt(errors[method])),
        }
        for method in METHODS
    ]


def _ours(space: ShapeSpace, cloud: Float[np.ndarray, "m 3"], refine: bool) -> Float[np.ndarray, "n 3"]:
    """Both clouds are coarse and hold no outliers: points are held together, none counts less."""
    fit = latent_fit(space, cloud, refine_pose=refine, matching=Matching(robust_scale=10.0, sliding=0.0))
    pose = fit.given_from_refined
    return space.field(fit.latent)(space.control_points) @ pose[:3, :3].T + pose[:3, 3]


def _predecessor(
    space: ShapeSpace, cloud: Float[np.ndarray, "m 3"], refine: bool
) -> Float[np.ndarray, "n 3"]:
    """Squared distances to all points, G W anew at each step."""
    points = space.control_points
    normalised = space.normaliser(points)
    kernel = gaussian(normalised, normalised, space.beta)

    def moved(state):
        latent, pose = np.split(state, [space.n_modes])
        shape = points + space.scale * (kernel @ space.decode(latent))
        return _apply(pose, shape)

    def residuals(state):
        return cdist(moved(state), cloud, "sqeuclidean").min(0)

    start = np.zeros(space.n_modes + 6 * refine)
    return moved(least_squares(residuals, start, method="lm").x)


def _nearest(space: ShapeSpace, cloud: Float[np.ndarray, "m 3"], refine: bool) -> Float[np.ndarray, "n 3"]:
    """Distances to the nearest point: its objective with our arithmetic."""
    points = space.control_points
    model = space.displacement_model(points)

    def moved(state):
        latent, pose = np.split(state, [space.n_modes])
        return _apply(pose, model.displaced(points, latent))

    def residuals(state):
        return KDTree(moved(state)).query(cloud)[0]

    start = np.zeros(space.n_modes + 6 * refine)
    return moved(least_squares(residuals, start, method="lm").x)


METHODS = {"grasptransfer": _ours, "predecessor": _predecessor, "nearest": _nearest}


def _apply(pose: Float[np.ndarray, "p"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Turn (rotation vector) and shift, or nothing."""
    return points @ Rotation.from_rotvec(pose[:3]).as_matrix().T + pose[3:] if len(pose) else points


def _read(settings: LatentFitSettings) -> tuple[dict, dict]:
    """Training and test clouds by name."""
    train: dict[str, Float[np.ndarray, "m 3"]] = {}
    test: dict[str, Float[np.ndarray, "m 3"]] = {}
    for source in find_sources(settings.data):
        suffix = source.path.suffix.lower()
        if suffix not in READERS:
            raise CategoryError("is no cloud", path=source.path, choices=READERS)
        (test if source.test else train)[source.name] = check_cloud(READERS[suffix](source.path), source.name)
    if len(train) < max(FEWEST_TRAINING, settings.n_modes + 1) or not test:
        raise CategoryError(
            f"{settings.n_modes} modes need {settings.n_modes + 1} clouds in train/, and one in test/",
            path=settings.data,
            value=f"{len(train)} and {len(test)}",
        )
    return train, test


def _most_central(clouds: dict[str, Float[np.ndarray, "m 3"]]) -> str:
    """The cloud that is least far from all others, once all are centred."""
    centred = [cloud - cloud.mean(0) for cloud in clouds.values()]
    trees = [KDTree(cloud) for cloud in centred]
    gaps = np.array([[np.square(tree.query(cloud)[0]).mean() for cloud in centred] for tree in trees])
    return list(clouds)[int((gaps + gaps.T).sum(1).argmin())]


def _learn(train: dict, canonical: str, settings: LatentFitSettings) -> ShapeSpace:
    """CPD from the canonical cloud to each other one; the canonical itself does not move."""
    source = PreparedSource(train[canonical], beta=settings.beta)
    others = [cloud for name, cloud in train.items() if name != canonical]
    weights = [result.field.weights for result in cpd_all(source, others, lam=settings.lam)]
    normaliser = source.normaliser
    return ShapeSpace.fit(
        np.stack([np.zeros_like(source.points), *weights]),
        source.points,
        source.beta,
        normaliser.centre,
        normaliser.scale,
        n_modes=settings.n_modes,
    )


def _summary(rows: list[dict]) -> dict:
    summary: dict[str, float] = {}
    for pose in ("kept", "refined"):
        of = {
            method: [row for row in rows if (row["method"], row["pose"]) == (method, pose)]
            for method in METHODS
        }
        ours = of["grasptransfer"]
        for method, theirs in of.items():
            summary[f"E_{method}_pose_{pose}"] = mean(row["E"] for row in theirs)
            summary[f"seconds_{method}_pose_{pose}"] = mean(row["seconds"] for row in theirs)
            if method == "grasptransfer":
                continue
            pairs = list(zip(ours, theirs, strict=True))
            summary[f"error_ratio_vs_{method}_pose_{pose}"] = mean(a["E"] / b["E"] for a, b in pairs)
            summary[f"speedup_vs_{method}_pose_{pose}"] = mean(b["seconds"] / a["seconds"] for a, b in pairs)
    return summary
