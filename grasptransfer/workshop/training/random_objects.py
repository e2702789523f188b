"""Objects of no category: heaps of plain solids, which an estimator has to refuse."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial


def draw_random_object(rng: np.random.Generator) -> trimesh.Scene:
    """One to four solids of random kind, size and colour, grown into each other [m]."""
    scene = trimesh.Scene()
    for _ in range(rng.integers(1, 5)):
        solid = _solid(rng)
        solid.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        solid.apply_translation(rng.normal(0, 0.03, 3))
        solid.visual = TextureVisuals(
            material=PBRMaterial(
                baseColorFactor=[*rng.uniform(0.02, 1, 3), 1.0],
                metallicFactor=float(rng.choice([0.0, 0.0, 0.9])),
                roughnessFactor=float(rng.uniform(0.15, 0.95)),
            )
        )
        scene.add_geometry(solid)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.random(random_state=rng).as_matrix()  # pyright: ignore[reportCallIssue]
    turn[:3, 3] = -turn[:3, :3] @ scene.bounds.mean(0)
    return scene.apply_transform(turn)


def _solid(rng: np.random.Generator) -> trimesh.Trimesh:
    size = np.exp(rng.uniform(np.log(0.015), np.log(0.12), 3))
    kind = rng.integers(6)
    if kind == 0:
        return trimesh.creation.box(size)
    if kind == 1:
        return trimesh.creation.cylinder(size[0] / 2, size[1])
    if kind == 2:
        return trimesh.creation.icosphere(3).apply_scale(size / 2)
    if kind == 3:
        return trimesh.creation.cone(size[0] / 2, size[1])
    if kind == 4:
        return trimesh.creation.torus(size[0] / 2, size[0] * rng.uniform(0.08, 0.2))
    return trimesh.creation.capsule(size[1], size[0] / 2)
