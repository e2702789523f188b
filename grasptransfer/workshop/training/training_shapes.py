"""Where training instances come from: parametric shapes (unlimited) or the meshes of a category."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from grasptransfer.category import Category, list_categories, load_category
from grasptransfer.category.category import SHAPE_SPACE
from grasptransfer.perception.networks import LATENT_SIZE
from grasptransfer.registration import DisplacementModel, LatentPosterior
from grasptransfer.workshop import objects

RHOS = (0.0, 0.25, 0.5, 0.75)  # section V-B: how far a shape is drawn back to the canonical model
RHO_SHARES = (0.7, 0.1, 0.1, 0.1)


LATENT_POINTS = 1200  # canonical points from which a shape's true latent is found
LATENT_NOISE = 1e-3  # m: what the shape space cannot express

Move = Callable[
    [Float[np.ndarray, "m 3"], Int[np.ndarray, "m"]], tuple[Float[np.ndarray, "m 3"], Bool[np.ndarray, "m"]]
]


@dataclass(frozen=True)
class TrainingShape:
    """An instance with its known motion from the canonical model.

    Args:
        scene: the textured instance, object frame [m].
        vertices: (v, 3) vertices of its surface, object frame [m].
        move: canonical points (m, 3) and the face of each -> points on the instance (m, 3), known (m,).
        latent: (k,) latent that explains the whole motion.
    """

    scene: trimesh.Scene | trimesh.Trimesh
    vertices: Float[np.ndarray, "v 3"]
    move: Move
    latent: Float[np.ndarray, "k"]


@dataclass(frozen=True)
class TrainingCanonical:
    """The canonical model that the training shapes of a category move, and how its space displaces it.

    Args:
        category: whose model it is.
        parametric: whether the category's shapes come from a generator, not from its meshes.
        mesh: geometry whose faces the training shapes move [m].
        model: displacement model of the mesh's vertices, with at most `LATENT_SIZE` modes.
    """

    category: Category
    parametric: bool
    mesh: trimesh.Trimesh
    model: DisplacementModel

    @property
    def n_modes(self) -> int:
        """Modes of the shape space."""
        return self.model.n_modes

    @cached_property
    def mode_size(self) -> Float[np.ndarray, "k"]:
        """How far one standard deviation of each mode moves the surface: root mean square [m]."""
        return np.sqrt(np.square(self.model.basis).sum(1).mean(0))

    def vertices(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """The vertices of the shape with this latent [m]."""
        return self.model.displaced(np.asarray(self.mesh.vertices), latent)

    def latent_of(self, displacements, known) -> Float[np.ndarray, "k"]:
        """The latent that explains these displacements (v, 3) [m] of the known vertices best."""
        chosen = np.flatnonzero(known)
        chosen = chosen[:: max(len(chosen) // LATENT_POINTS, 1)]
        return LatentPosterior.of(self.model.take(chosen), displacements[chosen], LATENT_NOISE).mean


def has_generator(category: Category) -> bool:
    """Whether the category is the shipped one of a parametric model, not merely its namesake."""
    if category.name not in objects.generators() or category.name not in list_categories():
        return False
    return category.canonical_sha256 == load_category(category.name).canonical_sha256


def training_canonical(category: Category) -> TrainingCanonical:
    """The canonical model of a category, for training."""
    return _canonical(category.folder, category.canonical_sha256, category.file.checksums.get(SHAPE_SPACE))


@lru_cache(maxsize=8)
def _canonical(folder: Path, *_checksums: str | None) -> TrainingCanonical:
    # The checksums distinguish a category that was built again from the one in the cache.
    category = load_category(folder)
    parametric = has_generator(category)
    mesh = objects.canonical(category.name).mesh() if parametric else category.canonical
    whole = category.shape_space.displacement_model(np.asarray(mesh.vertices))
    model = DisplacementModel(whole.mean, whole.basis[..., :LATENT_SIZE])
    return TrainingCanonical(category, parametric, mesh, model)


def instances_of(category: Category, *, held_out: bool) -> tuple[str, ...]:
    """Names of the instances to train on, or to hold out: without test instances both are the same."""
    return category.test if held_out and category.test else category.train


def without_held_out(categories: Iterable[Category]) -> list[str]:
    """Names of the categories of which every shape there is serves for training."""
    return [one.name for one in categories if not one.test and not has_generator(one)]


def draw_training_shape(
    canonical: TrainingCanonical, instances: Sequence[str], rng: np.random.Generator
) -> TrainingShape:
    """A random shape: a new parametric one where there is a generator, else one of these instances."""
    rho = float(rng.choice(RHOS, p=RHO_SHARES))
    if canonical.parametric:
        return _parametric(canonical, int(rng.integers(2**31)), rho)
    return _of_instance(canonical, instances[int(rng.integers(len(instances)))], rho)


def _parametric(canonical: TrainingCanonical, seed: int, rho: float) -> TrainingShape:
    name = canonical.category.name
    sample = objects.sample(name, seed).towards(objects.canonical(name), rho)
    rest, moved = canonical.mesh, sample.mesh()
    corresponds = np.asarray(sample.corresponds)

    def move(points, faces):
        corners = rest.faces[faces]
        weights = trimesh.triangles.points_to_barycentric(rest.vertices[corners], points)
        places = np.einsum("mc,mcd->md", weights, moved.vertices[corners])
        return places, np.asarray(corresponds[corners].all(1))

    latent = canonical.latent_of(moved.vertices - rest.vertices, corresponds)
    return TrainingShape(sample.scene(), np.asarray(moved.vertices), move, latent)


def _of_instance(canonical: TrainingCanonical, name: str, rho: float) -> TrainingShape:
    """Eq. 14: the instance drawn back by its own field to the canonical, keeping its texture."""
    category = canonical.category
    field = category.field(name)
    mesh = category.instance_mesh(name)
    if rho:
        drawn_back = mesh.copy()
        drawn_back.vertices = mesh.vertices - rho * field.displacement(field.inverse(mesh.vertices))
        mesh = drawn_back

    def move(points, _faces):
        return points + (1 - rho) * field.displacement(points), np.ones(len(points), bool)

    rest = np.asarray(canonical.mesh.vertices)
    moved, known = move(rest, np.zeros(len(rest), int))
    latent = canonical.latent_of(moved - rest, known)
    return TrainingShape(mesh, np.asarray(mesh.vertices), move, latent)
