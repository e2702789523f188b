"""The page of a built category: canonical model, every registration, the modes of its shape space."""

from html import escape
from pathlib import Path

import numpy as np
import trimesh

from grasptransfer.category.category import Category
from grasptransfer.files import write_whole
from grasptransfer.report.html_parts import facts, figure, jpeg_uri, pill, section, style_sheet, table
from grasptransfer.workshop.building.outcome import CategoryBuild, Registration
from grasptransfer.workshop.building.pictures import picture, scatter
from grasptransfer.workshop.building.space_fit import SMOOTH

SIDE = 190  # px of a picture
INSTANCE, MODEL = (28, 120, 150), (222, 98, 40)
MODES_SHOWN, STEPS = 5, (-2.0, -1.0, 0.0, 1.0, 2.0)
SCATTERED = 900  # points of a cloud that are drawn
_STYLE = """
.tiles { display: grid; gap: 8px; margin: 12px 0 0; }
.tiles.four { grid-template-columns: repeat(4, minmax(0, 1fr)); }
.tiles.five { grid-template-columns: repeat(5, minmax(0, 1fr)); }
.instance { border-top: 1px solid var(--line); padding: 14px 0; }
.instance h3 { margin: 0; font-size: 15px; }
.warning { color: var(--bad); margin: 4px 0 0; }
"""


def category_page(build: CategoryBuild, path: str | Path) -> Path:
    """Write the page of `build` as one self-contained HTML file.

    Args:
        build: of `building.build_category`.
        path: of the file.
    """
    path = Path(path)
    category = build.category
    style = style_sheet() + _STYLE
    title = f"Category {escape(category.name)}"
    parts = [_head(build), _candidates(build), _trials(build), _registrations(build), _modes(category)]
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{style}</style></head>'
        f"<body><main>{''.join(parts)}</main></body></html>"
    )
    write_whole(path, page.encode())
    return path


def _head(build: CategoryBuild) -> str:
    category, settings = build.category, build.category.settings
    measured = category.file.measured
    values = [
        ("canonical model", escape(build.canonical)),
        ("instances", f"{len(category.train)} train, {len(category.test)} test"),
        ("kernel", f"beta {settings.beta:g}, lambda {settings.lam:g}"),
        ("control points", str(settings.control_points)),
        ("modes", _modes_in_words(build)),
        ("leave one out", _left_out_in_words(measured)),
    ]
    warnings = "".join(f'<p class="warning">{escape(text)}</p>' for text in build.warnings)
    return f"<header><h1>Category {escape(category.name)}</h1>{facts(values)}{warnings}</header>"


def _modes_in_words(build: CategoryBuild) -> str:
    settings = build.category.settings
    smooth = 3 * SMOOTH if settings.flexibility else 0
    share = 100 * build.category.file.measured["explained_variance"]
    beside = f", and {smooth} smooth ones of flexibility {settings.flexibility:g}" if smooth else ""
    return f"{settings.modes - smooth} with {share:.4g} % of the variance{beside}"


def _left_out_in_words(measured: dict) -> str:
    mean, spread, worst = (measured[f"leave_one_out_error{kind}_um2"] for kind in ("", "_std", "_worst"))
    return f"E {mean:.1f} &plusmn; {spread:.1f}, worst {worst:.1f}"


def _trials(build: CategoryBuild) -> str:
    settings = build.category.settings
    if not build.trials:
        return ""
    shown = {}
    for one in sorted(build.trials, key=lambda one: one.error, reverse=True):
        shown[one.beta, one.lam, one.flexibility] = one  # the last is the best number of modes
    taken = shown[settings.beta, settings.lam, settings.flexibility]
    heads = [
        ("beta", True),
        ("lambda", True),
        ("modes", True),
        ("flexibility", True),
        ("E", True),
        ("", False),
    ]
    rows = [
        (
            f"{one.beta:g}",
            f"{one.lam:g}",
            str(one.modes),
            f"{one.flexibility:g}",
            _e(one.error),
            pill("taken", "good") if one == taken else "",
        )
        for one in sorted(shown.values(), key=lambda one: (one.beta, one.lam, one.flexibility))
    ]
    lead = (
        "Instances were left out in turn, and the shape space of the others was fitted to their points. "
        "E is what was left, on average, with the best number of modes. <i>Flexibility</i> is of smooth "
        "modes beside the learnt ones. Only control points were compared: below, with more points, E is less."
    )
    return section("Settings", lead, table(heads, rows))


def _candidates(build: CategoryBuild) -> str:
    if not build.candidates:
        return section("Canonical model", f"<b>{escape(build.canonical)}</b> was given.", "")
    heads = [("candidate", False), ("left mm", True), ("worst mm", True), ("moved mm", True), ("", False)]
    rows = [
        (
            escape(one.name),
            f"{1000 * one.chamfer:.2f}",
            f"{1000 * one.worst:.2f}",
            f"{1000 * one.moved:.1f}",
            pill("taken", "good") if one.name == build.canonical else "",
        )
        for one in build.candidates
    ]
    lead = (
        "Every train instance was registered to every other. <i>Left</i> is the chamfer distance that "
        "remains between a few points of each, averaged over the others; <i>moved</i> is how far points had "
        "to travel. Of those that leave about the least, the one that moves least is taken."
    )
    return section("Canonical model", lead, table(heads, rows))


def _registrations(build: CategoryBuild) -> str:
    canonical = build.category.canonical
    body = "".join(_registration(build.category, canonical, one) for one in build.registrations)
    lead = (
        "Each instance; the canonical model deformed to it; and the points of both "
        f"(<span style='color: rgb{INSTANCE}'>instance</span>, <span style='color: rgb{MODEL}'>canonical "
        "model</span>) before and after registration. E is the mean squared distance from the instance's "
        "points to the model's, in 1e-6 m<sup>2</sup>."
    )
    return section("Registrations", lead, body)


def _registration(category: Category, canonical: trimesh.Trimesh, one: Registration) -> str:
    field = category.field(one.name)
    model = category.shape_space.control_points
    extent = float(np.linalg.norm(np.maximum(one.extents, canonical.extents)))
    few = one.points[:: max(1, len(one.points) // SCATTERED)]
    tiles = [
        (picture(category.instance_scene(one.name), SIDE, extent=extent), "instance"),
        (
            picture(_deformed(canonical, field(canonical.vertices)), SIDE, extent=extent),
            "canonical, deformed",
        ),
        (
            scatter([(few, INSTANCE), (model, MODEL)], SIDE, extent=extent),
            f"before: E {_e(one.before.error)}",
        ),
        (
            scatter([(few, INSTANCE), (field(model), MODEL)], SIDE, extent=extent),
            f"after: E {_e(one.after.error)}, chamfer {1000 * one.after.chamfer:.2f} mm",
        ),
    ]
    size = " x ".join(f"{1000 * side:.0f}" for side in one.extents)
    words = [f"{size} mm", f"{one.faces} faces" if not one.is_cloud else "cloud", *one.notes]
    seen_by = "the others' shape space" if not one.test else "the shape space"
    words.append(f"{seen_by} fitted to its points: E\u00a0{_e(one.fitted_error)}")
    marks = pill("test", "neutral") if one.test else ""
    if one.status != "CONVERGED":
        word = "canonical model" if one.status == "IDENTITY" else one.status.lower().replace("_", " ")
        marks += pill(word, "neutral")
    warnings = "".join(f'<p class="warning">{escape(text)}</p>' for text in one.warnings)
    return (
        f'<div class="instance"><h3>{escape(one.name)} {marks}</h3>'
        f'<p class="lead">{escape("; ".join(words))}</p>{warnings}{_tiles(tiles, "four", one.name)}</div>'
    )


def _modes(category: Category) -> str:
    space, canonical = category.shape_space, category.canonical
    body = ""
    for mode in range(min(MODES_SHOWN, space.n_modes)):
        shapes = []
        for step in STEPS:
            latent = np.zeros(space.n_modes)
            latent[mode] = step
            shapes.append(_deformed(canonical, space.field(latent)(canonical.vertices)))
        extent = max(float(np.linalg.norm(shape.extents)) for shape in shapes)
        tiles = [
            (picture(shape, SIDE, extent=extent), f"{step:+g} sd" if step else "mean")
            for shape, step in zip(shapes, STEPS, strict=True)
        ]
        body += f"<h3>Mode {mode + 1}</h3>{_tiles(tiles, 'five', f'mode {mode + 1}')}"
    return section("Shape space", "Its first modes, in standard deviations from the mean shape.", body)


def _tiles(tiles, columns: str, name: str) -> str:
    figures = "".join(
        figure(jpeg_uri(image), escape(caption), alt=f"{name}: {caption}") for image, caption in tiles
    )
    return f'<div class="tiles {columns}">{figures}</div>'


def _deformed(mesh: trimesh.Trimesh, vertices) -> trimesh.Trimesh:
    assert mesh.visual is not None
    return trimesh.Trimesh(vertices, mesh.faces, visual=mesh.visual.copy(), process=False)


def _e(error: float) -> str:
    return f"{1e6 * error:.1f}"
