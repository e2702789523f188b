"""`category build`: from a folder of meshes to a category (section III, for any user's objects).

Check and repair the meshes, choose the canonical model, register it to every instance by CPD, choose the
settings by leaving instances out, and learn the shape space. Test instances are registered too, to measure
against, and teach nothing.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.category.assemble import write_category
from grasptransfer.category.choices import (
    Chosen,
    Options,
    choose_canonical,
    choose_settings,
    fields_of,
    register,
    starts_of,
)
from grasptransfer.category.clouds import visible_surface, voxel_filter, voxel_for
from grasptransfer.category.learning import FEWEST, Distances
from grasptransfer.category.orientation import agreed_turn
from grasptransfer.category.outcome import Candidate, CategoryBuild, Registration
from grasptransfer.category.settings import Settings, Split
from grasptransfer.category.sources import Source, find_sources, frame_rotation
from grasptransfer.category.tasks import (
    COMPARED_POINTS,
    learn,
    mesh_of,
    prepare_instance,
    thinned,
)
from grasptransfer.category.workshop import Arrays, Progress, Workshop
from grasptransfer.errors import CategoryError, SettingsError
from grasptransfer.files import sha256
from grasptransfer.registration import ShapeSpace


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
    beta: float | None = None,
    lam: float | None = None,
    outlier_weight: float = 0.0,
    modes: int | None = None,
    flexibility: float | None = None,
    metric: str = "GW",
    control_points: int = 650,
    workers: int = 2,
    overwrite: bool = False,
    description: str = "",
    progress: Callable[[Progress], None] = lambda _: None,
    finish: Callable[[CategoryBuild], object] = lambda _: None,
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
        beta: kernel width of CPD, in units of the canonical cloud's RMS radius. lam: its smoothness. None
            tries several and takes those whose shape space leaves least of instances it never saw.
        outlier_weight: of CPD, in [0, 1).
        modes: of the shape space; None takes the fewest with nearly the least error of such instances.
        flexibility: of smooth modes beside the learnt ones, for what few instances cannot show: standard
            deviation along each axis, in RMS radii; None tries several.
        metric: of the principal components: "GW", "G" or "W".
        control_points: about how many.
        workers: processes.
        overwrite: replace an existing folder (its grasps are kept).
        progress: called at each step and for each finished instance.
        finish: called with the result, to write a page of it, say; killed while it runs, the build resumes.

    Raises:
        CategoryError: no meshes, too few, an unknown name, or `out` exists.
        MeshError, PointCloudError: a file that cannot be used; the error names it and the fix.
        SettingsError: an option out of range.
    """
    start = time.perf_counter()
    out = Path(out) if out is not None else Path(name)
    kept = out.with_name(f".{out.name}.build")
    if out.exists() and not overwrite and not kept.exists():
        raise CategoryError("exists already", path=out, fix="Give another folder, or --overwrite")
    _check_options(scale, workers)
    options = Options(beta, lam, outlier_weight, modes, flexibility, metric, control_points)
    sources = _sources(Path(meshes), canonical, tuple(test))
    split = {source.name: source.test for source in sources}
    with Workshop(kept, workers=workers, progress=progress) as workshop:
        prepared = _prepare(workshop, sources, scale, frame_rotation(front, up))
        train = {one: arrays for one, arrays in prepared.items() if not split[one]}
        candidates: tuple[Candidate, ...] = ()
        if canonical is None:
            candidates = choose_canonical(workshop, train, options)
            canonical = candidates[0].name
        control, voxel = _control_points(prepared[canonical], control_points)
        model = prepared[canonical]["points"]
        how = {"kernels": options.kernels(), "outlier_weight": outlier_weight}
        registered = register(workshop, train, canonical, control, model, **how)
        chosen, trials = choose_settings(workshop, train, registered, control, options)
        how["kernels"] = [(chosen.beta, chosen.lam)]
        found = register(workshop, prepared, canonical, control, model, **how)
        learnt, space = _learn(workshop, prepared, train, found, model, control, chosen, metric)
        registered = {one: arrays for (one, _, _), arrays in found.items()}
        registrations = _registrations(split, prepared, registered, learnt, canonical)
        progress(Progress("write", 0, 1))
        category = write_category(
            out,
            name,
            description=description,
            split=Split(
                canonical=canonical, train=tuple(train), test=tuple(one for one in split if split[one])
            ),
            settings=_settings(chosen, space, outlier_weight, voxel, len(train)),
            measured=_measured(registrations, canonical, learnt["explained"], chosen.modes),
            canonical_glb=prepared[canonical]["glb"].tobytes(),
            instance_glbs={one: arrays["glb"].tobytes() for one, arrays in prepared.items()},
            shape_space=space,
            weights={one: registered[one]["weights"] for one in sorted(split, key=lambda one: split[one])},
        )
        progress(Progress("write", 1, 1, name))
        seconds = time.perf_counter() - start
        built = CategoryBuild(
            category, canonical, candidates, trials, registrations, learnt["explained"], seconds
        )
        finish(built)
        workshop.clear()
    return built


def _check_options(scale: float, workers: int) -> None:
    if not (np.isfinite(scale) and scale > 0):
        raise SettingsError("must be above 0", key="scale", value=scale)
    if workers < 1:
        raise SettingsError("must be at least 1", key="workers", value=workers)


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


def _control_points(model: Arrays, count: int) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Points of the canonical model, and the edge of the voxel filter that left them [m]."""
    points = model["points"] if model["is_cloud"] else visible_surface(mesh_of(model["glb"]))[0]
    voxel = voxel_for(points, min(count, len(points)))
    return points[voxel_filter(points, voxel)], voxel


def _learn(workshop, prepared: dict[str, Arrays], train, registered, model, control, chosen, metric):
    """Final shape space, and what was measured with it."""
    others = [name for name in prepared if name not in train]
    clouds = [prepared[name]["points"] for name in (*train, *others)]
    given = fields_of(train, registered, control, chosen.beta, chosen.lam) | {
        "modes": chosen.modes,
        "flexibility": chosen.flexibility,
        "metric": metric,
        "model": model,
        "clouds": np.concatenate(clouds),
        "starts": starts_of(clouds),
    }
    learnt = workshop.map("learn", learn, {"shape_space": given})["shape_space"]
    errors = dict(zip((*train, *others), learnt.pop("fitted_error"), strict=True))
    normaliser = (given["centre"], given["scale"])
    found = (learnt["mean"], learnt["basis"], learnt["variances"], float(learnt["noise_variance"]))
    space = ShapeSpace(control, chosen.beta, *normaliser, *found, metric)
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


def _settings(
    chosen: Chosen, space: ShapeSpace, outlier_weight: float, voxel: float, samples: int
) -> Settings:
    return Settings(  # pyright: ignore[reportCallIssue]  knows `lam` by its name in the file alone
        beta=chosen.beta,
        lam=chosen.lam,  # pyright: ignore[reportCallIssue]
        modes=space.n_modes,
        flexibility=chosen.flexibility,
        metric=space.metric,  # pyright: ignore[reportArgumentType]  checked by the shape space
        correspondences="cpd",
        outlier_weight=outlier_weight,
        control_points=len(space.control_points),
        voxel=voxel,
        samples=samples,
    )


def _measured(
    registrations: tuple[Registration, ...], canonical: str, explained, modes: int
) -> dict[str, float]:
    # The canonical model cannot be left out: the control points are its own.
    left_out = [one for one in registrations if not one.test and one.name != canonical]
    rms = np.array([one.left_out_rms for one in left_out])
    error = np.array([one.fitted_error for one in left_out])
    seen = {
        "undeformed_rms_mm": 1000 * np.mean([one.before.rms for one in registrations]),
        "registered_rms_mm": 1000 * np.mean([one.after.rms for one in registrations]),
        "leave_one_out_rms_mm": 1000 * np.sqrt(np.square(rms).mean()),
        "leave_one_out_error_um2": 1e6 * error.mean(),
        "leave_one_out_error_std_um2": 1e6 * error.std(),
        "leave_one_out_error_worst_um2": 1e6 * error.max(),
    }
    test = [one.fitted_error for one in registrations if one.test]
    if test:
        seen["test_error_um2"] = 1e6 * np.mean(test)
    measured = {key: round(float(value), 4) for key, value in seen.items()}
    return {**measured, "explained_variance": round(float(explained[modes - 1]), 6)}
