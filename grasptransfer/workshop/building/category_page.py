"""The page of a built category: canonical model, every registration, the modes of its shape space."""

from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import UInt8

from grasptransfer.category.category import Category
from grasptransfer.drawing.contact_sheet import portrait
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.files import write_whole
from grasptransfer.report.embedded import jpeg_uri
from grasptransfer.report.html import Fact, Figure, render
from grasptransfer.workshop.building.cloud_pictures import scatter
from grasptransfer.workshop.building.outcome import CategoryBuild, Registration
from grasptransfer.workshop.building.space_fit import SMOOTH

SIDE = 190  # px of a picture
INSTANCE, MODEL = (28, 120, 150), (222, 98, 40)
MODES_SHOWN, STEPS = 5, (-2.0, -1.0, 0.0, 1.0, 2.0)
SCATTERED = 900  # points of a cloud that are drawn


def category_page(build: CategoryBuild, path: str | Path) -> Path:
    """Write the page of `build` as one self-contained HTML file.

    Args:
        build: result of `building.build_category`.
        path: path of the file.
    """
    path = Path(path)
    trials = _best_trials(build)
    settings = build.category.settings
    with Renderer() as renderer:
        registrations = [_registration(build.category, one, renderer) for one in build.registrations]
        modes = _modes(build.category, renderer)
    page = render(
        "category.html",
        folder=Path(__file__).parent,
        title=f"Category {build.category.name}",
        summary=_summary(build),
        warnings=build.warnings,
        canonical=build.canonical,
        candidates=build.candidates,
        trials=list(trials.values()),
        taken=trials.get((settings.beta, settings.lam, settings.flexibility)),
        instance_colour=INSTANCE,
        model_colour=MODEL,
        registrations=registrations,
        modes=modes,
    )
    write_whole(path, page.encode())
    return path


def _summary(build: CategoryBuild) -> list[Fact]:
    category, settings = build.category, build.category.settings
    return [
        Fact("canonical model", build.canonical),
        Fact("instances", f"{len(category.train)} train, {len(category.test)} test"),
        Fact("kernel", f"beta {settings.beta:g}, lambda {settings.lam:g}"),
        Fact("control points", str(settings.control_points)),
        Fact("modes", _modes_in_words(build)),
        Fact("leave one out", _left_out_in_words(category.file.measured)),
    ]


def _modes_in_words(build: CategoryBuild) -> str:
    settings = build.category.settings
    smooth = 3 * SMOOTH if settings.flexibility else 0
    share = 100 * build.category.file.measured["explained_variance"]
    beside = f", and {smooth} smooth ones of flexibility {settings.flexibility:g}" if smooth else ""
    return f"{settings.modes - smooth} with {share:.4g} % of the variance{beside}"


def _left_out_in_words(measured: dict) -> str:
    mean, spread, worst = (measured[f"leave_one_out_error{kind}_um2"] for kind in ("", "_std", "_worst"))
    return f"E {mean:.1f} ± {spread:.1f}, worst {worst:.1f}"


def _best_trials(build: CategoryBuild) -> dict:
    """Of each kernel, smoothness and flexibility the trial with the best number of modes, in order."""
    best = {}
    for one in sorted(build.trials, key=lambda one: one.error, reverse=True):
        best[one.beta, one.lam, one.flexibility] = one  # The last one stays: it has the least error.
    return dict(sorted(best.items()))


def _registration(category: Category, one: Registration, renderer: Renderer) -> dict:
    marks = ["test"] if one.test else []
    if one.status != "CONVERGED":
        marks.append("canonical model" if one.status == "IDENTITY" else one.status.lower().replace("_", " "))
    return {
        "name": one.name,
        "marks": marks,
        "words": _registration_in_words(one),
        "warnings": one.warnings,
        "tiles": _registration_tiles(category, one, renderer),
    }


def _registration_in_words(one: Registration) -> str:
    size = " x ".join(f"{1000 * side:.0f}" for side in one.extents)
    words = [f"{size} mm", f"{one.faces} faces" if not one.is_cloud else "cloud", *one.notes]
    seen_by = "the shape space" if one.test else "the others' shape space"
    words.append(f"{seen_by} fitted to its points: E\u00a0{_e(one.fitted_error)}")
    return "; ".join(words)


def _registration_tiles(category: Category, one: Registration, renderer: Renderer) -> list[Figure]:
    field, canonical = category.field(one.name), category.canonical
    model = category.shape_space.control_points
    extent = float(np.linalg.norm(np.maximum(one.extents, canonical.extents)))
    few = one.points[:: max(1, len(one.points) // SCATTERED)]
    deformed = _deformed(canonical, field(canonical.vertices))
    before = f"before: E {_e(one.before.error)}"
    after = f"after: E {_e(one.after.error)}, chamfer {1000 * one.after.chamfer:.2f} mm"
    tiles = [
        (_picture(category.instance_scene(one.name), renderer, extent), "instance"),
        (_picture(deformed, renderer, extent), "canonical, deformed"),
        (scatter([(few, INSTANCE), (model, MODEL)], SIDE, extent=extent), before),
        (scatter([(few, INSTANCE), (field(model), MODEL)], SIDE, extent=extent), after),
    ]
    return [Figure(jpeg_uri(image), f"{one.name}: {caption}", caption) for image, caption in tiles]


def _modes(category: Category, renderer: Renderer) -> list[list[Figure]]:
    """Pictures of the first modes, each from the lowest step to the highest."""
    space, canonical = category.shape_space, category.canonical
    modes = []
    for mode in range(min(MODES_SHOWN, space.n_modes)):
        shapes = []
        for step in STEPS:
            latent = np.zeros(space.n_modes)
            latent[mode] = step
            shapes.append(_deformed(canonical, space.field(latent)(canonical.vertices)))
        extent = max(float(np.linalg.norm(shape.extents)) for shape in shapes)
        captions = [f"{step:+g} sd" if step else "mean" for step in STEPS]
        modes.append(
            [
                Figure(jpeg_uri(_picture(shape, renderer, extent)), f"mode {mode + 1}: {caption}", caption)
                for shape, caption in zip(shapes, captions, strict=True)
            ]
        )
    return modes


def _picture(
    shape: trimesh.Trimesh | trimesh.Scene, renderer: Renderer, extent: float
) -> UInt8[np.ndarray, "side side 3"]:
    return portrait(shape, renderer, SIDE, extent=extent, ground=(255, 255, 255))


def _deformed(mesh: trimesh.Trimesh, vertices) -> trimesh.Trimesh:
    assert mesh.visual is not None
    return trimesh.Trimesh(vertices, mesh.faces, visual=mesh.visual.copy(), process=False)


def _e(error: float) -> str:
    return f"{1e6 * error:.1f}"
