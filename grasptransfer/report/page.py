"""The report of one transfer: a single HTML file that asks for nothing from outside."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

import grasptransfer
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.studio import CANONICAL, RECONSTRUCTION, Studio
from grasptransfer.files import write_whole
from grasptransfer.frames import invert, rotation_angle
from grasptransfer.report.embedded import jpeg_uri
from grasptransfer.report.execution_section import execution, outcome_of
from grasptransfer.report.grasp_pictures import GraspPictures
from grasptransfer.report.html import Fact, Figure, render
from grasptransfer.report.pictures import FOUND, GIVEN, MASK, DeformationMaps, Pictures
from grasptransfer.report.scene_view import drawn_grippers, scene_page, shown_grasps

if TYPE_CHECKING:
    from grasptransfer.perception.pose_prior import PoseDeviation
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
    executed_why: str = "",
) -> Path:
    """Write a self-contained HTML page: picture, reconstruction, deformation, every grasp and why.

    Args:
        result: of a transfer.
        path: the file to write.
        trials: results of `simulate`; they belong to the grasps of the same names.
        executed_mesh: what the grasps were executed on, object frame [m]; None: the reconstruction.
        executed_why: one sentence on which grasps were executed and why those.

    Raises:
        SettingsError: the file cannot be written.
    """
    path = Path(path)
    trials = tuple(trials or ())
    with Renderer() as renderer:
        studio = Studio(renderer)
        pictures, drawn = Pictures(result, studio), GraspPictures.of(result, studio)
        text = render(
            "transfer.html",
            title=headline(result),
            lead=_lead(result),
            summary=_summary(result, trials),
            seen=_seen(pictures),
            scene=scene_page(result) if result.usable else "",
            obstacles=result.scene is not None,
            shape=_shape(pictures),
            grasps=[_grasp(grasp, drawn, trials) for grasp in result.grasps],
            stages=_stages(result),
            version=grasptransfer.__version__,
            **_deformation(pictures.deformation()),
            **execution(result, trials, studio, executed_mesh=executed_mesh, why=executed_why),
        )
    write_whole(path, text.encode("utf-8"))
    return path


def headline(result: "TransferResult") -> str:
    """How many grasps are usable, on what."""
    usable, every = len(result.usable), len(result.grasps)
    thing = result.category.name.replace("_", " ")
    if not usable:
        return f"None of the {every} grasps on this {thing} is usable"
    return f"{usable} of {every} grasps on this {thing} {'is' if usable == 1 else 'are'} usable"


def _lead(result: "TransferResult") -> str:
    if not result.usable:
        return _advice(result)
    best = result.usable[0]
    return f"{_advice(result)} Best grasp: {best.name}, expected success {best.score:.0%}."


def _advice(result: "TransferResult") -> str:
    return " ".join(filter(None, (result.pose_note, result.advice)))


def _summary(result: "TransferResult", trials: Sequence) -> list[Fact]:
    status, score = result.status.value, result.category_score
    facts = [
        Fact("category", result.category.name),
        Fact("shape", status.replace("_", " "), "good" if status == "ok" else "bad"),
        Fact("fits category, pose and box", "not judged" if score is None else f"{score:.0%}"),
        Fact("gripper", result.gripper.name),
        Fact("pose refined by", _pose_change(result)),
        *_pose_sigmas(result),
    ]
    if result.observation.further:
        facts.append(Fact("pictures", str(len(result.observation.pictures))))
    if "total" in result.timings:
        facts.append(Fact("time", _duration(result.timings["total"])))
    if trials:
        held = sum(trial.held for trial in trials)
        facts.append(Fact("executed and held", f"{held} of {len(trials)}", "good" if held else "bad"))
    return facts


def _pose_change(result: "TransferResult") -> str:
    given_from_refined = invert(result.observation.camera_from_object) @ result.camera_from_object
    degrees = np.degrees(rotation_angle(given_from_refined[:3, :3]))
    return f"{np.linalg.norm(given_from_refined[:3, 3]) * 1e3:.1f} mm, {degrees:.1f}°"


def _pose_sigmas(result: "TransferResult") -> list[Fact]:
    """How sure the pose is before and after the picture: along the ray, across it, and its turn."""
    after = result.pose_sigma_posterior
    if after is None or not after.turn:
        return []
    before = result.pose_sigma_prior
    given = [] if before is None else [Fact("given pose sure to", _sigma_text(before))]
    return [*given, Fact("pose sure to", _sigma_text(after))]


def _sigma_text(sigma: "PoseDeviation") -> str:
    along, across = 1e3 * sigma.along_ray, 1e3 * sigma.across_ray
    return f"{along:.1f} mm along the ray, {across:.1f} mm across, {sigma.turn:.1f}°"


def _seen(pictures: Pictures) -> list[Figure]:
    figures = [
        Figure(
            jpeg_uri(pictures.photograph()),
            "photograph",
            "The photograph; the other pictures show what is framed.",
        )
    ]
    mask = pictures.mask()
    if mask is not None:
        legend = ((MASK, "Pixels taken for the object"),)
        figures.append(Figure(jpeg_uri(mask), "mask over the photograph", legend=legend))
    legend = ((FOUND, "Reconstruction at the refined pose"), (GIVEN, "canonical model at the given pose"))
    figures.append(Figure(jpeg_uri(pictures.outlines()), "outlines over the photograph", legend=legend))
    if pictures.result.usable:
        best, *others = [grasp.name for grasp in shown_grasps(pictures.result)]
        caption = f"The opened gripper at {best}" + (
            f"; its fingers at {', '.join(others)}" if others else ""
        )
        picture = pictures.with_grippers(drawn_grippers(pictures.result))
        figures.append(Figure(jpeg_uri(picture), "grippers over the photograph", caption))
    return figures


def _shape(pictures: Pictures) -> list[Figure]:
    result, sides = pictures.result, pictures.sides()
    models = (
        ("Canonical model", CANONICAL, result.category.canonical),
        ("Reconstruction", RECONSTRUCTION, result.mesh),
    )
    figures = []
    for side, pair in (("as seen", sides["observed"]), ("the hidden side", sides["hidden"])):
        for (name, colour, mesh), picture in zip(models, pair, strict=True):
            size = " × ".join(f"{1e3 * extent:.0f}" for extent in mesh.extents)
            caption = f", {side}: {size} mm" if side == "as seen" else f", {side}"
            figures.append(Figure(jpeg_uri(picture), f"{name}, {side}", caption, ((colour, name),)))
    return figures


def _deformation(maps: DeformationMaps) -> dict:
    meanings = ("x, to the front", "y, to the left", "z, up")
    figures = [
        Figure(
            jpeg_uri(picture),
            f"displacement along {meaning}",
            f"Along {meaning}: at most {largest:.1f} mm",
        )
        for picture, meaning, largest in zip(maps.pictures, meanings, maps.largest_mm, strict=True)
    ]
    return {"deformation": figures, "limit_mm": maps.limit_mm, "colours": maps.colours}


def _grasp(grasp: "TransferredGrasp", drawn: GraspPictures, trials: Sequence) -> dict:
    return {
        "name": grasp.name,
        "label": grasp.label,
        "status": grasp.status.value,
        "kind": "good" if grasp.usable else "bad",
        "score": f"{grasp.score:.2f}",
        "width": f"{1e3 * grasp.width:.1f}",
        "opening": f"{1e3 * grasp.opening:.1f}",
        "approach": f"{1e3 * grasp.approach_distance:.0f}",
        "reason": grasp.reason,
        "executed": outcome_of(grasp.name, trials),
        "uri": jpeg_uri(drawn.draw(grasp)),
        "poses": "\n\n".join(
            f"{name}\n{_matrix(getattr(grasp, name))}"
            for name in ("object_from_gripper", "camera_from_gripper")
        ),
    }


def _matrix(matrix: np.ndarray) -> str:
    return "\n".join(" ".join(f"{value:9.5f}" for value in line) for line in matrix)


def _stages(result: "TransferResult") -> list[dict]:
    longest = max(result.timings.values(), default=0) or 1
    stages = [stage for stage in STAGES if stage in result.timings]
    stages += [stage for stage in result.timings if stage not in STAGES]
    return [
        {
            "name": STAGES.get(stage, stage),
            "sum": stage in SUMS,
            "share": 100 * result.timings[stage] / longest,
            "duration": _duration(result.timings[stage]),
        }
        for stage in stages
    ]


def _duration(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1 else f"{1e3 * seconds:.0f} ms"
