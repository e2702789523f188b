"""Predicted and true deformation of what is seen, as colours (the paper's figure 7)."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from grasptransfer.drawing.boxes import projected_box, union
from grasptransfer.drawing.rendering import Renderer, position_image
from grasptransfer.files import write_whole
from grasptransfer.perception.zoom import zoom_box, zoom_camera, zoom_picture
from grasptransfer.registration import DeformationField
from grasptransfer.workshop.benchmark.estimators import EstimatorSet
from grasptransfer.workshop.benchmark.seen_instances import (
    Instance,
    instance_names,
    load_instance,
    see_instance,
)

VIEWPOINT = 50  # of the 74: from in front, a little aside and above
AXES = ("x", "y", "z")
CELL = 1.6  # inches


@dataclass(frozen=True)
class DeformationMap:
    """One row of the figure.

    Args:
        title: category and instance.
        picture: (h, w, 3) the zoomed observation.
        predicted, true: (h, w, 3) displacement [m] along the object's axes of the canonical point seen in
            each pixel; NaN where the canonical model is not.
    """

    title: str
    picture: UInt8[np.ndarray, "h w 3"]
    predicted: Float[np.ndarray, "h w 3"]
    true: Float[np.ndarray, "h w 3"]

    @property
    def error_mm(self) -> float:
        """Mean length of the difference [mm]."""
        return 1e3 * float(np.nanmean(np.linalg.norm(self.predicted - self.true, axis=-1)))


def map_deformation(
    instance: Instance,
    *,
    renderer: Renderer,
    method: str = "rgb",
    weights: Path | None = None,
    viewpoint: int = VIEWPOINT,
    seed: int = 0,
) -> DeformationMap:
    """See an instance and compare the estimated field with the true one at the canonical's visible pixels.

    Args:
        method: one of `estimators.OF_SHAPES`.
        viewpoint: index of the 74.
    """
    sight = see_instance(instance, viewpoint, renderer=renderer, seed=seed)
    seen, category = sight.observation, instance.category
    kit = EstimatorSet(refine_pose=False, weights=weights)
    estimate = kit.of(instance, (method,))[method](seen)
    box = projected_box(np.asarray(category.canonical.vertices), seen.camera, sight.pose)
    crop = zoom_box(box if seen.box is None else union(box, seen.box))
    camera = zoom_camera(seen.camera, crop)
    positions = position_image(renderer.depth(category.canonical, camera, sight.pose), camera, sight.pose)
    return DeformationMap(
        f"{category.name}\n{instance.name}",
        zoom_picture(seen.image, crop),
        _displacements(estimate.field, positions),
        _displacements(instance.true_field, positions),
    )


def draw_deformation_maps(
    categories: Sequence[str],
    path: Path,
    *,
    method: str = "rgb",
    meshes: Path | None = None,
    weights: Path | None = None,
    seed: int = 0,
) -> list[DeformationMap]:
    """Write the figure as PNG: the first instance of every category, in the benchmark's lights.

    Args:
        method: whose prediction is drawn.
        meshes: as of `bench registration`.
    """
    maps = []
    with Renderer() as renderer:
        for row, category in enumerate(categories):  # each before another background
            instance = load_instance(category, instance_names(category, meshes)[0], meshes)
            maps.append(
                map_deformation(instance, renderer=renderer, method=method, weights=weights, seed=seed + row)
            )
    _write(_figure(maps, method), path)
    return maps


def _displacements(
    field: DeformationField, positions: Float[np.ndarray, "h w 3"]
) -> Float[np.ndarray, "h w 3"]:
    seen = np.isfinite(positions).all(-1)
    moved = np.full(positions.shape, np.nan)
    moved[seen] = field.displacement(positions[seen].astype(float))
    return moved


def _figure(maps: list[DeformationMap], method: str):
    from matplotlib.figure import Figure

    columns = 2 + 2 * len(AXES) + 1
    figure = Figure(figsize=(CELL * columns, CELL * 0.86 * len(maps) + 0.35), layout="constrained")
    grid = figure.subplots(len(maps), columns, squeeze=False, width_ratios=[1, *[1] * (columns - 2), 0.06])
    headings = ["observed", *(f"{method} {a}" for a in AXES), *(f"true {a}" for a in AXES), "difference"]
    for axis, heading in zip(grid[0], headings, strict=False):
        axis.set_title(heading, fontsize=9)
    for row, one in zip(grid, maps, strict=True):
        _draw_row(figure, row, one)
    return figure


def _draw_row(figure, row, one: DeformationMap):
    limit = 1e3 * float(np.nanmax(np.abs([one.predicted, one.true])))
    row[0].imshow(one.picture)
    row[0].set_ylabel(one.title, fontsize=7)
    pictures = [part[..., a] for part in (one.predicted, one.true) for a in range(3)]
    for axis, values in zip(row[1:7], pictures, strict=True):
        shown = axis.imshow(1e3 * values, cmap="RdBu_r", vmin=-limit, vmax=limit)
    difference = 1e3 * np.linalg.norm(one.predicted - one.true, axis=-1)
    row[7].imshow(difference, cmap="magma_r", vmin=0, vmax=limit)
    row[7].set_xlabel(f"mean {one.error_mm:.1f} mm", fontsize=7)
    for axis in row[:8]:
        axis.set_xticks([])
        axis.set_yticks([])
    figure.colorbar(shown, cax=row[8]).set_label("mm", fontsize=7)
    row[8].tick_params(labelsize=6)


def _write(figure, path: Path):
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    write_whole(path, buffer.getvalue())
