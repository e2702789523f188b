"""Where training instances come from: parametric shapes (unlimited) or the meshes of a category."""

import numpy as np
import trimesh

from grasptransfer import shapes
from grasptransfer.category import Category, load_category
from grasptransfer.perception.samples import TrainingShape

RHOS = (0.0, 0.25, 0.5, 0.75)  # section V-B: how far a shape is drawn back to the canonical model
RHO_SHARES = (0.7, 0.1, 0.1, 0.1)


def training_canonical(name: str) -> trimesh.Trimesh:
    """The canonical geometry whose faces the training shapes of this category move."""
    if name in shapes.generators():
        return shapes.canonical(name).mesh()
    return load_category(name).canonical


def draw_training_shape(name: str, rng: np.random.Generator) -> TrainingShape:
    """A random training instance: a new parametric shape where there is a generator, else a train mesh."""
    rho = float(rng.choice(RHOS, p=RHO_SHARES))
    if name in shapes.generators():
        return _parametric(name, int(rng.integers(2**31)), rho)
    category = load_category(name)
    return _of_instance(category, int(rng.integers(len(category.train))), rho)


def _parametric(name: str, seed: int, rho: float) -> TrainingShape:
    canonical = shapes.canonical(name)
    sample = shapes.sample(name, seed).towards(canonical, rho)
    rest, moved = canonical.mesh(), sample.mesh()

    def move(points, faces):
        corners = rest.faces[faces]
        weights = trimesh.triangles.points_to_barycentric(rest.vertices[corners], points)
        places = np.einsum("mc,mcd->md", weights, moved.vertices[corners])
        return places, sample.corresponds[corners].all(1)

    return TrainingShape(sample.scene(), np.asarray(moved.vertices), move)


def _of_instance(category: Category, index: int, rho: float) -> TrainingShape:
    """Eq. 14: the instance drawn back by its own field to the canonical, keeping its texture."""
    field = category.training_field(index)
    mesh = category.instance_mesh(category.train[index])
    if rho:
        drawn_back = mesh.copy()
        drawn_back.vertices = mesh.vertices - rho * field.displacement(field.inverse(mesh.vertices))
        mesh = drawn_back

    def move(points, _faces):
        return points + (1 - rho) * field.displacement(points), np.ones(len(points), bool)

    return TrainingShape(mesh, np.asarray(mesh.vertices), move)
