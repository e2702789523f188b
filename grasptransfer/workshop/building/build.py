"""`category build`: from a folder of meshes to a category (section III, for any user's objects).

Check and repair the meshes, choose the canonical model, register it to every instance by CPD, choose the
settings by leaving instances out, and learn the shape space. Test instances are registered too, to measure
against, and teach nothing.
"""

import hashlib
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from grasptransfer.category.category import Category
from grasptransfer.category.settings import FILE_NAME, Settings, Split
from grasptransfer.errors import CategoryError
from grasptransfer.files import sha256, write_whole
from grasptransfer.workshop.building.kept_tasks import Arrays, BuildProgress, Workshop
from grasptransfer.workshop.building.learn import LearntCategory, learn_category
from grasptransfer.workshop.building.outcome import CategoryBuild
from grasptransfer.workshop.building.settings import BuildSettings
from grasptransfer.workshop.building.sources import Source, find_sources, frame_rotation
from grasptransfer.workshop.building.space_fit import FEWEST
from grasptransfer.workshop.building.tasks import prepare_instance
from grasptransfer.workshop.building.writing import CategoryContent, write_category

WRITTEN = "written"  # among a build's kept results, once its category stands: whose it is


def build_category(
    settings: BuildSettings,
    *,
    progress: Callable[[BuildProgress], None] = lambda _: None,
    finish: Callable[[CategoryBuild], object] = lambda _: None,
) -> CategoryBuild:
    """Build a category folder from meshes and clouds; killed and started again, it resumes.

    Args:
        settings: what it is built from, and how.
        progress: called at each step and for each finished instance.
        finish: called with the result, to write a page of it, say; killed while it runs, the build resumes.

    Raises:
        CategoryError: no meshes, too few, an unknown name, or `out` exists.
        MeshError, PointCloudError: a file that cannot be used; the error names it and the fix.
        SettingsError: axes that are none.
    """
    start = time.perf_counter()
    out = settings.folder
    kept = out.with_name(f".{out.name}.build")
    sources = _sources(settings)
    asked = _checksum(settings, sources)
    _check_place(out, kept, asked, overwrite=settings.overwrite)
    split = {source.name: source.test for source in sources}
    with Workshop(kept, workers=settings.workers, progress=progress) as workshop:
        prepared = _prepare(workshop, sources, settings.scale, frame_rotation(settings.front, settings.up))
        learnt = learn_category(workshop, prepared, split, settings=settings)
        progress(BuildProgress("write", 0, 1))
        category = _write(learnt, prepared, split, settings)
        write_whole(kept / WRITTEN, _mark(out, asked))
        progress(BuildProgress("write", 1, 1, settings.name))
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


def _checksum(settings: BuildSettings, sources: list[Source]) -> str:
    """Of all that the result depends on: the meshes by their content, wherever they lie."""
    files = [(source.name, source.test, sha256(source.path)) for source in sources]
    how = replace(settings, meshes=Path(), out=None, test=(), workers=1, overwrite=False)
    return hashlib.sha256(repr((files, how)).encode()).hexdigest()


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


def _sources(settings: BuildSettings) -> list[Source]:
    meshes, canonical = Path(settings.meshes), settings.canonical
    sources = find_sources(meshes, tuple(settings.test))
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
    learnt: LearntCategory, prepared: dict[str, Arrays], split: dict[str, bool], settings: BuildSettings
) -> Category:
    train = tuple(one for one in split if not split[one])
    test = tuple(one for one in split if split[one])
    content = CategoryContent(
        name=settings.name,
        description=settings.description,
        density=settings.density,
        split=Split(canonical=learnt.canonical, train=train, test=test),
        settings=_settings(learnt, settings, len(train)),
        measured=_measured(learnt),
        canonical_glb=prepared[learnt.canonical]["glb"].tobytes(),
        instance_glbs={one: arrays["glb"].tobytes() for one, arrays in prepared.items()},
        shape_space=learnt.space,
        weights={one: learnt.weights[one] for one in (*train, *test)},
    )
    return write_category(settings.folder, content)


def _settings(learnt: LearntCategory, given: BuildSettings, samples: int) -> Settings:
    return Settings(
        beta=learnt.chosen.beta,
        lam=learnt.chosen.lam,
        modes=learnt.space.n_modes,
        flexibility=learnt.chosen.flexibility,
        metric=learnt.space.metric,
        correspondences="cpd",
        outlier_weight=given.outlier_weight,
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
