"""The shipped categories: parametric shapes turned into category folders.

The correspondences are known, so each shape's field is a plain least-squares fit, and the width of
the kernel, its smoothness and the number of modes are chosen by what they leave on shapes held out.
`python -m grasptransfer.workshop.building.parametric.library FOLDER [NAME …]` writes them, or all of them.
"""

import io
import logging
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import trimesh
import tyro
from PIL import Image
from tyro.conf import Positional

from grasptransfer.category.category import Category, objects_folder
from grasptransfer.category.settings import Settings, Split
from grasptransfer.errors import CategoryError, GraspTransferError
from grasptransfer.workshop.building.parametric.canonical_surface import CanonicalPoints, surface_of
from grasptransfer.workshop.building.parametric.cpd_accuracy import CpdAccuracy, cpd_accuracy
from grasptransfer.workshop.building.parametric.space_choice import Choice, choose_space, fit_weights
from grasptransfer.workshop.building.writing import CategoryContent, glb_of, write_category
from grasptransfer.workshop.objects import ParametricObject, canonical, generators, sample
from grasptransfer.workshop.objects.recipe import load_recipe

FIRST_TRAINING_SEED, FIRST_HELDOUT_SEED = 1_000_000, 2_000_000
TEXTURE_SIDE, JPEG_QUALITY = 512, 88
SMALLEST_JPEG = 64  # px; below, PNG is smaller


def build_shipped_category(
    name: str,
    out: Path | None = None,
    *,
    samples: int = 400,
    heldout: int = 100,
    progress: Callable[[str], None] = lambda step: None,
) -> Category:
    """Write the folder of a category that has a parametric model; grasps already there are kept.

    Args:
        name: one of `objects.generators()`.
        out: the folder to write; `objects/<name>` if None.
        samples: random shapes behind the shape space, besides the curated train instances.
        heldout: other random shapes, by which the settings are chosen.
        progress: called with one line at each step.

    Raises:
        CategoryError: there is no parametric model of that name.
    """
    if name not in generators():
        raise CategoryError("has no parametric model", key=name, choices=generators())
    curated = load_recipe(name)
    model = canonical(name)
    progress(f"{name}: points of the canonical model")
    surface = surface_of(model)
    progress(f"{name}: {samples + heldout} random shapes")
    train, test = _instances(name, curated.train), _instances(name, curated.test)
    learnt = [surface.displacements(shape) for shape in train.values()]
    learnt += [surface.displacements(sample(name, FIRST_TRAINING_SEED + i)) for i in range(samples)]
    unseen = [surface.displacements(sample(name, FIRST_HELDOUT_SEED + i)) for i in range(heldout)]
    progress(f"{name}: choosing kernel, smoothness and modes")
    choice = choose_space(surface.points, surface.control_points, np.stack(learnt), np.stack(unseen))
    progress(f"{name}: chose {choice.summary}")
    instances = {**train, **test}
    moved = np.stack([surface.displacements(shape) for shape in instances.values()])
    weights = fit_weights(surface.points, choice.space, choice.regularisation, moved)
    progress(f"{name}: accuracy of CPD, and writing")
    content = CategoryContent(
        name=name,
        description=curated.description,
        density=curated.density,
        split=Split(canonical="canonical", train=tuple(train), test=tuple(test)),
        settings=_settings(choice, surface, len(learnt)),
        measured={**choice.measured, **_of_cpd(cpd_accuracy(surface)[0])},
        canonical_glb=glb_of(compact(model.scene())),
        instance_glbs={key: glb_of(compact(shape.scene())) for key, shape in instances.items()},
        shape_space=choice.space,
        weights=dict(zip(instances, weights, strict=True)),
    )
    return write_category(Path(out) if out else objects_folder() / name, content)


def _instances(name: str, seeds: Iterable[int]) -> dict[str, ParametricObject]:
    return {f"{name}_{seed:04d}": sample(name, seed) for seed in seeds}


def compact(scene: trimesh.Scene) -> trimesh.Scene:
    """The scene with textures of at most `TEXTURE_SIDE` pixels, opaque ones as JPEG."""
    for part in scene.geometry.values():
        material = part.visual.material
        image = material.baseColorTexture
        if max(image.size) > TEXTURE_SIDE:
            ratio = TEXTURE_SIDE / max(image.size)
            size = (max(1, round(image.width * ratio)), max(1, round(image.height * ratio)))
            image = image.resize(size, Image.Resampling.LANCZOS)
        if image.mode == "RGB" and max(image.size) >= SMALLEST_JPEG:
            buffer = io.BytesIO()
            image.save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)
            image = Image.open(buffer)  # Its format lets the GLB writer keep it as JPEG.
        material.baseColorTexture = image
    return scene


def _of_cpd(best: CpdAccuracy) -> dict[str, float]:
    """The best settings of CPD for this category, and what they leave, for `category.yaml`."""
    return {
        "cpd_beta": best.beta,
        "cpd_lambda": best.lam,
        "cpd_correspondence_mean_mm": round(1000 * best.mean, 4),
        "cpd_correspondence_p95_mm": round(1000 * best.p95, 4),
        "cpd_correspondence_mean_share": round(best.mean_share, 6),
        "cpd_correspondence_p95_share": round(best.p95_share, 6),
    }


def _settings(choice: Choice, surface: CanonicalPoints, samples: int) -> Settings:
    return Settings(
        beta=choice.space.beta,
        lam=choice.regularisation,
        modes=choice.space.n_modes,
        metric="GW",
        correspondences="exact",
        control_points=len(surface.control_points),
        voxel=surface.voxel,
        samples=samples,
    )


def main(folder: Positional[Path], names: Positional[tuple[str, ...]] = ()) -> None:
    """Make the shipped categories.

    Args:
        folder: to write each into, under its name.
        names: names of the categories; all if none is given.
    """
    for name in names or generators():
        build_shipped_category(name, folder / name, progress=logging.info)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        tyro.cli(main)
    except GraspTransferError as error:
        logging.error(error)
        sys.exit(2)
