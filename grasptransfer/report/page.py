"""The report of one transfer: a single HTML file without scripts and without anything from elsewhere."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

import grasptransfer
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.files import write_whole
from grasptransfer.report.grasp_pictures import GraspPictures
from grasptransfer.report.html_parts import (
    facts,
    figure,
    jpeg_uri,
    key,
    matrix_text,
    pill,
    row,
    section,
    style_sheet,
    table,
)
from grasptransfer.report.pictures import FOUND, MASK, TOLD, DeformationMaps, Pictures
from grasptransfer.report.studio import CANONICAL, RECONSTRUCTION, Studio
from grasptransfer.report.trial_section import executed_by_name, trial_pill, trial_section

if TYPE_CHECKING:
    from grasptransfer.result import TransferredGrasp, TransferResult
    from grasptransfer.simulation import TrialResult

STAGES = {
    "network": "Network",
    "fit": "Fit of shape and pose",
    "score": "Category score",
    "cpd": "CPD",
    "depth": "Fit to depth",
    "shape": "Shape, altogether",
    "reconstruct": "Reconstruct",
    "warp": "Warp",
    "refine": "Refine",
    "check": "Check",
    "doubt": "Draw plausible objects",
    "place": "Place",
    "rank": "Rank",
    "grasps": "Grasps, altogether",
    "total": "Total",
}
SUMS = ("shape", "grasps", "total")


def write_page(
    result: "TransferResult",
    path: str | Path,
    *,
    trials: "Sequence[TrialResult] | None" = None,
    executed_mesh: trimesh.Trimesh | None = None,
) -> Path:
    """Write a self-contained HTML page: picture, reconstruction, deformation, every grasp and why.

    Args:
        result: of a transfer.
        path: the file to write.
        trials: what PyBullet made of the grasps, told apart by grasp name.
        executed_mesh: what they were executed on, object frame [m]; None: the reconstruction.

    Raises:
        SettingsError: the file cannot be written.
    """
    path = Path(path)
    trials = tuple(trials or ())
    with Renderer() as renderer:
        studio = Studio(renderer)
        pictures = Pictures(result, studio)
        parts = [
            _seen(pictures),
            _shape(pictures),
            _deformation(pictures.deformation()),
            _grasps(result, GraspPictures.of(result, studio), trials),
            trial_section(result, trials, studio, executed_mesh=executed_mesh) if trials else "",
            _timings(result),
        ]
    text = _document(result, trials, "".join(parts))
    write_whole(path, text.encode("utf-8"))
    return path


def _document(result: "TransferResult", trials: Sequence, body: str) -> str:
    style = style_sheet()
    title = headline(result)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body><main>"
        f"<header><h1>{escape(title)}</h1>{_summary(result, trials)}</header>{body}{_footer()}"
        "</main></body></html>"
    )


def headline(result: "TransferResult") -> str:
    """How many grasps are usable, on what."""
    usable, every = len(result.usable), len(result.grasps)
    thing = result.category.name.replace("_", " ")
    if not usable:
        return f"None of the {every} grasps on this {thing} is usable"
    return f"{usable} of {every} grasps on this {thing} {'is' if usable == 1 else 'are'} usable"


def _summary(result: "TransferResult", trials: Sequence) -> str:
    lead = result.status.advice
    if result.usable:
        best = result.usable[0]
        lead += f" Best grasp: {best.name}, expected success {best.score:.0%}."
    fits, fit = result.status.value == "ok", result.category_score
    pairs = [
        ("category", escape(result.category.name)),
        ("shape", pill(result.status.value.replace("_", " "), "good" if fits else "bad")),
        ("fits the category", "not judged" if fit is None else f"{fit:.0%}"),
        ("gripper", escape(result.gripper.name)),
        ("pose refined by", _pose_change(result)),
    ]
    if "total" in result.timings:
        pairs.append(("time", _duration(result.timings["total"])))
    if trials:
        held = sum(trial.held for trial in trials)
        pairs.append(("held in PyBullet", pill(f"{held} of {len(trials)}", "good" if held else "bad")))
    return f'<p class="lead">{escape(lead)}</p>{facts(pairs)}'


def _pose_change(result: "TransferResult") -> str:
    from grasptransfer.frames import invert, rotation_angle

    change = invert(result.observation.camera_from_object) @ result.camera_from_object
    degrees = np.degrees(rotation_angle(change[:3, :3]))
    return f"{np.linalg.norm(change[:3, 3]) * 1e3:.1f} mm, {degrees:.1f}°"


def _seen(pictures: Pictures) -> str:
    figures = [
        figure(
            jpeg_uri(pictures.photograph()), "The photograph; the frame is what follows.", alt="photograph"
        )
    ]
    mask = pictures.mask()
    if mask is not None:
        caption = f"{key(MASK)}Pixels taken for the object"
        figures.append(figure(jpeg_uri(mask), caption, alt="mask over the photograph"))
    caption = f"{key(FOUND)}Reconstruction at the refined pose, {key(TOLD)}canonical model at the told pose"
    figures.append(figure(jpeg_uri(pictures.outlines()), caption, alt="outlines over the photograph"))
    lead = "The closer the blue line follows the object, the better shape and pose explain the picture."
    return section("What was seen", lead, row(figures, "three" if len(figures) == 3 else "two"))


def _shape(pictures: Pictures) -> str:
    sides = pictures.sides()
    result = pictures.result
    names = (f"{key(CANONICAL)}Canonical model", f"{key(RECONSTRUCTION)}Reconstruction")
    sizes = [
        " × ".join(f"{1e3 * side:.0f}" for side in mesh.extents) + " mm"
        for mesh in (result.category.canonical, result.mesh)
    ]
    figures = [
        figure(jpeg_uri(picture), f"{name}, {side}" + (f": {size}" if side == "as seen" else ""), alt=side)
        for side, pair in (("as seen", sides["observed"]), ("the hidden side", sides["hidden"]))
        for name, size, picture in zip(names, sizes, pair, strict=True)
    ]
    lead = (
        "The annotated model of the category, and the same model deformed to this instance. The hidden side "
        "is inferred from the category. Each row has one scale; sizes are along x (front), y, z (up)."
    )
    return section("Shape", lead, row(figures, "two"))


def _deformation(maps: DeformationMaps) -> str:
    meanings = ("x, to the front", "y, to the left", "z, up")
    figures = [
        figure(
            jpeg_uri(picture),
            f"Along {meaning}: at most {largest:.1f} mm",
            alt=f"displacement along {meaning}",
        )
        for picture, meaning, largest in zip(maps.pictures, meanings, maps.largest_mm, strict=True)
    ]
    gradient = ", ".join(f"rgb{colour}" for colour in maps.colours)
    scale = (
        f'<div class="scale"><span>−{maps.limit_mm:g} mm</span>'
        f'<span class="bar" style="background: linear-gradient(to right, {gradient})"></span>'
        f"<span>+{maps.limit_mm:g} mm</span></div>"
    )
    lead = "How far each visible point of the canonical model moves to the instance, along the object's axes."
    return section("Deformation", lead, row(figures, "three") + scale)


def _grasps(result: "TransferResult", drawn: GraspPictures, trials: Sequence) -> str:
    executed = executed_by_name(trials)
    heads = [
        ("#", True),
        ("grasp", False),
        ("label", False),
        ("checks", False),
        ("score", True),
        ("width mm", True),
        ("opening mm", True),
    ]
    if executed:
        heads.append(("PyBullet", False))
    heads.append(("why", False))
    rows, cards = [], []
    for number, grasp in enumerate(result.grasps, 1):
        trial = trial_pill(executed.get(grasp.name, ())) if executed else ""
        cells = [
            str(number),
            f'<a href="#grasp-{number}">{escape(grasp.name)}</a>',
            escape(grasp.label),
            _status_pill(grasp),
            f"{grasp.score:.2f}",
            f"{1e3 * grasp.width:.1f}",
            f"{1e3 * grasp.opening:.1f}",
        ]
        rows.append([*cells, *([trial] if executed else []), escape(grasp.reason)])
        cards.append(_card(number, grasp, jpeg_uri(drawn.draw(grasp)), trial))
    lead = (
        "Best first. The score is the expected success over shapes and poses that the picture leaves open. "
        "Pictures show the gripper opened as it arrives, with green fingers where every check passed."
    )
    return section("Grasps", lead, table(heads, rows) + f'<div class="cards">{"".join(cards)}</div>')


def _status_pill(grasp: "TransferredGrasp") -> str:
    return pill(grasp.status.value, "good" if grasp.usable else "bad")


def _card(number: int, grasp: "TransferredGrasp", uri: str, trial: str) -> str:
    poses = (
        "object_from_gripper\n" + matrix_text(grasp.object_from_gripper)
        + "\n\ncamera_from_gripper\n" + matrix_text(grasp.camera_from_gripper)
    )  # fmt: skip
    return (
        f'<article class="card" id="grasp-{number}"><img src="{uri}" alt="gripper at {escape(grasp.name)}">'
        f'<div class="text"><h3>{number}. {escape(grasp.name)}</h3>{_status_pill(grasp)} {trial}'
        f"<p>{escape(grasp.reason[:1].upper() + grasp.reason[1:])}.</p>"
        f"<p>Score {grasp.score:.2f}, width {1e3 * grasp.width:.1f} mm, arrives {1e3 * grasp.opening:.1f} mm "
        f"open over the last {1e3 * grasp.approach_distance:.0f} mm.</p>"
        f"<details><summary>Poses of the TCP [m]</summary><pre>{poses}</pre></details></div></article>"
    )


def _timings(result: "TransferResult") -> str:
    longest = max(result.timings.values(), default=0) or 1
    stages = [stage for stage in STAGES if stage in result.timings]
    stages += [stage for stage in result.timings if stage not in STAGES]
    rows = "".join(
        f"<tr{' class=total' if stage in SUMS else ''}><td>{escape(STAGES.get(stage, stage))}</td>"
        f'<td class="track"><i style="width: {100 * result.timings[stage] / longest:.1f}%"></i></td>'
        f'<td class="number">{_duration(result.timings[stage])}</td></tr>'
        for stage in stages
    )
    return section("Time", "Of this transfer, without loading models.", f'<table class="bars">{rows}</table>')


def _duration(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1 else f"{1e3 * seconds:.0f} ms"


def _footer() -> str:
    return (
        f"<footer><p>grasptransfer {grasptransfer.__version__}. Metres unless said otherwise. "
        "<code>camera</code>: OpenCV axes (x right, y down, z forward). <code>object</code>: z up, +x its "
        "front, origin at the centre of the bounding box. <code>gripper</code>: the TCP between the pads, "
        "+z approach, +x closing. <code>a_from_b</code> maps points of frame b to frame a.</p></footer>"
    )
