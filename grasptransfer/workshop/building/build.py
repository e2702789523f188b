"""`category build`: from a folder of meshes to a category (section III, for any user's objects).

Check and repair the meshes, choose the canonical model, register it to every instance by CPD, choose the
settings by leaving instances out, and learn the shape space. Test instances are registered too, to measure
against, and teach nothing.
"""

import hashlib
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from grasptransfer.category.category import Category
from grasptransfer.category.settings import FILE_NAME, NAME, Settings, Split
from grasptransfer.errors import CategoryError, SettingsError
from grasptransfer.files import sha256, write_whole
from grasptransfer.registration import Metric
from grasptransfer.workshop.building.choices import Options
from grasptransfer.workshop.building.kept_tasks import Arrays, Progress, Workshop
from grasptransfer.workshop.building.learn import LearntCategory, learn_category
from grasptransfer.workshop.building.outcome import CategoryBuild
from grasptransfer.workshop.building.sources import Source, find_sources, frame_rotation
from grasptransfer.workshop.building.space_fit import FEWEST
from grasptransfer.workshop.building.tasks import prepare_instance
from grasptransfer.workshop.building.writing import write_category

WRITTEN = "written"  # among a build's kept results, once its category stands: whose it is


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
    metric: Metric = "GW",
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
    _check_options(name, scale, workers)
    out = Path(out) if out is not None else Path(name)
    kept = out.with_name(f".{out.name}.build")
    options = Options(beta, lam, outlier_weight, modes, flexibility, metric, control_points)
    sources = _sources(Path(meshes), canonical, tuple(test))
    asked = _checksum(name, sources, canonical, front, up, scale, options, description)
    _check_place(out, kept, asked, overwrite=overwrite)
    split = {source.name: source.test for source in sources}
    with Workshop(kept, workers=workers, progress=progress) as workshop:
        prepared = _prepare(workshop, sources, scale, frame_rotation(front, up))
        learnt = learn_category(workshop, prepared, split, canonical=canonical, options=options)
        progress(Progress("write", 0, 1))
        category = _write(out, name, learnt, prepared, split=split, options=options, description=description)
        write_whole(kept / WRITTEN, _mark(out, asked))
        progress(Progress("write", 1, 1, name))
        built = CategoryBuild(
            category,
            learnt.canonical,
            learnt.candidates,
            learnt.trials,
            learnt.registrations,
            learnt.explained,
            time.perf_counter() - start,
        )
        finish(built)
        workshop.clear()
    return built


def _check_options(name: str, scale: float, workers: int) -> None:
    if not re.match(NAME, name):
        raise CategoryError("must be letters, digits, _ and -", key="name", value=name)
    if not (np.isfinite(scale) and scale > 0):
        raise SettingsError("must be above 0", key="scale", value=scale)
    if workers < 1:
        raise SettingsError("must be at least 1", key="workers", value=workers)


def _checksum(name: str, sources: list[Source], *how: object) -> str:
    """Of all that a build is asked for."""
    files = [(source.name, source.test, sha256(source.path)) for source in sources]
    return hashlib.sha256(repr((name, files, how)).encode()).hexdigest()


def _mark(out: Path, asked: str) -> bytes:
    return f"{asked} {sha256(out / FILE_NAME)}".encode()


def _check_place(out: Path, kept: Path, asked: str, *, overwrite: bool) -> None:
    """Refuse to replace what is there, unless this very build left it and was killed before its end."""
    if not out.exists():
        return
    if not out.is_dir():
        raise CategoryError("is not a folder", path=out, fix="Give another folder")
    if (out / FILE_NAME).exists():
        resumed = (kept / WRITTEN).is_file() and (kept / WRITTEN).read_bytes() == _mark(out, asked)
    else:
        resumed = kept.exists()
    if not (overwrite or resumed):
        raise CategoryError("exists already", path=out, fix="Give another folder, or --overwrite")


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


def _write(
    out: Path,
    name: str,
    learnt: LearntCategory,
    prepared: dict[str, Arrays],
    *,
    split: dict[str, bool],
    options: Options,
    description: str,
) -> Category:
    train = tuple(one for one in split if not split[one])
    test = tuple(one for one in split if split[one])
    return write_category(
        out,
        name,
        description=description,
        split=Split(canonical=learnt.canonical, train=train, test=test),
        settings=_settings(learnt, options, len(train)),
        measured=_measured(learnt),
        canonical_glb=prepared[learnt.canonical]["glb"].tobytes(),
        instance_glbs={one: arrays["glb"].tobytes() for one, arrays in prepared.items()},
        shape_space=learnt.space,
        weights={one: learnt.weights[one] for one in (*train, *test)},
    )


def _settings(learnt: LearntCategory, options: Options, samples: int) -> Settings:
    return Settings(
        beta=learnt.chosen.beta,
        lam=learnt.chosen.lam,
        modes=learnt.space.n_modes,
        flexibility=learnt.chosen.flexibility,
        metric=learnt.space.metric,
        correspondences="cpd",
        outlier_weight=options.outlier_weight,
        control_points=len(learnt.space.control_points),
        voxel=learnt.voxel,
        samples=samples,
    )


def _measured(learnt: LearntCategory) -> dict[str, float]:
    registrations = learnt.registrations
    # The canonical model cannot be left out: the control points are its own.
    left_out = [one for one in registrations if not one.test and one.name != learnt.canonical]
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
    return {**measured, "explained_variance": round(float(learnt.explained[learnt.chosen.modes - 1]), 6)}
