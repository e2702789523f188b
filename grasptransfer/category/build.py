"""`category build`: from a folder of meshes to a category (section III, for any user's objects).

Check and repair the meshes, choose the canonical model, register it to every instance by CPD and learn
the shape space. Test instances are registered too, to measure against, and teach nothing.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.category.assemble import write_category
from grasptransfer.category.clouds import visible_surface, voxel_filter, voxel_for
from grasptransfer.category.learning import FEWEST, Distances
from grasptransfer.category.orientation import best_turn
from grasptransfer.category.outcome import Candidate, CategoryBuild, Registration
from grasptransfer.category.settings import Settings, Split
from grasptransfer.category.sources import Source, find_sources, frame_rotation
from grasptransfer.category.tasks import (
    COMPARED_POINTS,
    compare_candidate,
    learn,
    mesh_of,
    prepare_instance,
    register_instance,
    thinned,
)
from grasptransfer.category.workshop import Arrays, Progress, Workshop
from grasptransfer.errors import CategoryError, SettingsError
from grasptransfer.files import sha256
from grasptransfer.registration import ShapeSpace

# Of those measured on parametric shapes, near the true points and near the surface in every category.
DEFAULT_BETA, DEFAULT_LAMBDA = 2.0, 3.0


@dataclass(frozen=True)
class Options:
    """How instances are registered and the shape space is learnt; see `build_category`."""

    beta: float
    lam: float
    outlier_weight: float
    modes: int | None
    metric: str
    control_points: int


def build_category(
    name: str,
    *,
    meshes: str | Path,
    canonical: str | None = None,
    test: Sequence[str] = (),
    out: str | Path | None = None,
    front: str = "+x",
    up: str = "+z",
    scale: float = 1.0,
    beta: float = DEFAULT_BETA,
    lam: float = DEFAULT_LAMBDA,
    outlier_weight: float = 0.0,
    modes: int | None = None,
    metric: str = "GW",
    control_points: int = 650,
    workers: int = 2,
    overwrite: bool = False,
    description: str = "",
    progress: Callable[[Progress], None] = lambda _: None,
) -> CategoryBuild:
    """Build a category folder from meshes and clouds; killed and started again, it resumes.

    Args:
        name: of the category.
        meshes: folder of `NAME.obj` or `NAME/mesh.obj` (glb gltf obj ply stl off pcd xyz), also below
            `train/` and `test/`.
        canonical: name of the instance to take; None scores every train instance and takes the best.
        test: names of instances to keep out of the shape space.
        out: folder to write; `NAME` in the working directory if None.
        front, up: axes of the files that become +x and +z.
        scale: metres in one unit of the files.
        beta: kernel width of CPD, in units of the canonical cloud's RMS radius. lam: its smoothness.
        outlier_weight: of CPD, in [0, 1).
        modes: of the shape space; None takes the fewest with nearly the least leave-one-out error.
        metric: of the principal components: "GW", "G" or "W".
        control_points: about how many.
        workers: processes.
        overwrite: replace an existing folder (its grasps are kept).
        progress: called at each step and for each finished instance.

    Raises:
        CategoryError: no meshes, too few, an unknown name, or `out` exists.
        MeshError, PointCloudError: a file that cannot be used; the error names it and the fix.
        SettingsError: an option out of range.
    """
    start = time.perf_counter()
    out = Path(out) if out is not None else Path(name)
    if out.exists() and not overwrite:
        raise CategoryError("exists already", path=out, fix="Give another folder, or --overwrite")
    _check_options(scale, workers, modes, control_points)
    options = Options(beta, lam, outlier_weight, modes, metric, control_points)
    sources = _sources(Path(meshes), canonical, tuple(test))
    split = {source.name: source.test for source in sources}
    with Workshop(out.with_name(f".{out.name}.build"), workers=workers, progress=progress) as workshop:
        prepared = _prepare(workshop, sources, scale, frame_rotation(front, up))
        train = {one: arrays for one, arrays in prepared.items() if not split[one]}
        candidates = () if canonical else _candidates(workshop, train, options)
        canonical = canonical or candidates[0].name
        control, voxel = _control_points(prepared[canonical], control_points)
        registered = _register(workshop, prepared, canonical, control, options)
        learnt, space = _learn(workshop, train, registered, prepared[canonical]["points"], control, options)
        registrations = _registrations(split, prepared, registered, learnt, canonical)
        progress(Progress("write", 0, 1))
        category = write_category(
            out,
            name,
            description=description,
            split=Split(
                canonical=canonical, train=tuple(train), test=tuple(one for one in split if split[one])
            ),
            settings=_settings(options, space, voxel, len(train)),
            measured=_measured(registrations, learnt["explained"], space.n_modes),
            canonical_glb=prepared[canonical]["glb"].tobytes(),
            instance_glbs={one: arrays["glb"].tobytes() for one, arrays in prepared.items()},
            shape_space=space,
            weights={one: registered[one]["weights"] for one in sorted(split, key=lambda one: split[one])},
        )
        workshop.clear()
        progress(Progress("write", 1, 1, name))
    seconds = time.perf_counter() - start
    return CategoryBuild(category, canonical, candidates, registrations, learnt["explained"], seconds)


def _check_options(scale: float, workers: int, modes: int | None, control_points: int) -> None:
    if not (np.isfinite(scale) and scale > 0):
        raise SettingsError("must be above 0", key="scale", value=scale)
    least = {"workers": (workers, 1), "modes": (modes, 1), "control_points": (control_points, 50)}
    for key, (value, smallest) in least.items():
        if value is not None and value < smallest:
            raise SettingsError(f"must be at least {smallest}", key=key, value=value)


def _sources(meshes: Path, canonical: str | None, test: tuple[str, ...]) -> list[Source]:
    sources = find_sources(meshes, test)
    names = [source.name for source in sources]
    train = sum(not source.test for source in sources)
    if train < FEWEST:
        raise CategoryError(f"needs at least {FEWEST} train meshes", path=meshes, value=train)
    if canonical is not None and canonical not in names:
        raise CategoryError("is not there", path=meshes, key=f"canonical {canonical}", choices=names)
    return sources


def _prepare(workshop: Workshop, sources: list[Source], scale: float, rotation) -> dict[str, Arrays]:
    given = {
        source.name: {
            "path": str(source.path),
            "checksum": sha256(source.path),
            "scale": scale,
            "rotation": rotation,
        }
        for source in sources
    }
    return workshop.map("check", prepare_instance, given)


def _candidates(workshop: Workshop, train: dict[str, Arrays], options: Options) -> tuple[Candidate, ...]:
    """Every train instance registered to every other, best first."""
    small = {name: thinned(arrays["points"], COMPARED_POINTS) for name, arrays in train.items()}
    given = {}
    for name in train:
        others = [small[other] for other in train if other != name]
        given[name] = {"candidate": small[name], "others": np.concatenate(others), "starts": _starts(others)}
        given[name] |= {"beta": options.beta, "lam": options.lam}
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
    return tuple(sorted(candidates, key=lambda one: (one.is_cloud, one.chamfer, one.name)))


def _control_points(model: Arrays, count: int) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Points of the canonical model, and the edge of the voxel filter that left them [m]."""
    points = model["points"] if model["is_cloud"] else visible_surface(mesh_of(model["glb"]))[0]
    voxel = voxel_for(points, min(count, len(points)))
    return points[voxel_filter(points, voxel)], voxel


def _register(workshop, prepared: dict[str, Arrays], canonical: str, control, options: Options):
    shared = {
        "control_points": control,
        "model": prepared[canonical]["points"],
        "beta": options.beta,
        "lam": options.lam,
        "outlier_weight": options.outlier_weight,
    }
    given = {
        one: {**shared, "instance": arrays["points"], "is_canonical": one == canonical}
        for one, arrays in prepared.items()
    }
    return workshop.map("register", register_instance, given)


def _learn(workshop, train: dict[str, Arrays], registered: dict[str, Arrays], model, control, options):
    """The results of `tasks.learn`, and the shape space."""
    clouds = [arrays["points"] for arrays in train.values()]
    first = registered[next(iter(train))]
    given = {
        "weights": np.stack([registered[name]["weights"] for name in train]),
        "control_points": control,
        "centre": first["centre"],
        "scale": float(first["scale"]),
        "beta": options.beta,
        "modes": options.modes or 0,
        "metric": options.metric,
        "model": model,
        "instances": np.concatenate(clouds),
        "starts": _starts(clouds),
    }
    learnt = workshop.map("learn", learn, {"shape_space": given})["shape_space"]
    normaliser = (given["centre"], given["scale"])
    found = (learnt["mean"], learnt["basis"], learnt["variances"], float(learnt["noise_variance"]))
    return learnt, ShapeSpace(control, options.beta, *normaliser, *found, options.metric)


def _registrations(
    split: dict[str, bool], prepared, registered, learnt, canonical: str
) -> tuple[Registration, ...]:
    small = thinned(prepared[canonical]["points"], COMPARED_POINTS)
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
                turn=best_turn(small, thinned(arrays["points"], COMPARED_POINTS)),
                points=arrays["points"],
                before=Distances(*(float(number) for number in result["before"])),
                after=Distances(*(float(number) for number in result["after"])),
                status=str(result["status"]),
                left_out_rms=None if number is None else float(learnt["left_out_rms"][number]),
                left_out_error=None if number is None else float(learnt["left_out_error"][number]),
            )
        )
    return tuple(found)


def _settings(options: Options, space: ShapeSpace, voxel: float, samples: int) -> Settings:
    return Settings(
        beta=options.beta,
        lam=options.lam,
        modes=space.n_modes,
        metric=options.metric,  # pyright: ignore[reportArgumentType]  checked by the shape space
        correspondences="cpd",
        outlier_weight=options.outlier_weight,
        control_points=len(space.control_points),
        voxel=voxel,
        samples=samples,
    )


def _measured(registrations: tuple[Registration, ...], explained, modes: int) -> dict[str, float]:
    seen = [one for one in registrations if not one.test]
    left_out = np.array([one.left_out_rms for one in seen])
    error = np.array([one.left_out_error for one in seen])
    return {
        "undeformed_rms_mm": round(1000 * float(np.mean([one.before.rms for one in registrations])), 4),
        "registered_rms_mm": round(1000 * float(np.mean([one.after.rms for one in registrations])), 4),
        "leave_one_out_rms_mm": round(1000 * float(np.sqrt(np.square(left_out).mean())), 4),
        "leave_one_out_error_um2": round(1e6 * float(error.mean()), 4),
        "explained_variance": round(float(explained[modes - 1]), 6),
    }


def _starts(clouds: Sequence[Float[np.ndarray, "_ 3"]]) -> np.ndarray:
    return np.cumsum([0, *(len(cloud) for cloud in clouds)])
