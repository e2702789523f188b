"""Instances whose shape is known, and pictures of them: what the benchmarks look at."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from PIL import Image

from grasptransfer.camera import Camera
from grasptransfer.category import Category, load_category
from grasptransfer.errors import MeshError
from grasptransfer.perception.backgrounds import draw_background
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.scenes import PoseNoise, draw_lighting
from grasptransfer.perception.views import sphere_views
from grasptransfer.registration import DeformationField, cpd

CAMERA = Camera.from_fov(640, 480, np.deg2rad(60))
FILL = 0.55  # share of the picture's height that the object covers
MESH_SUFFIXES = (".glb", ".obj", ".ply", ".off", ".stl")


@dataclass(frozen=True)
class Instance:
    """An instance that no training saw.

    Args:
        mesh: object frame [m], with its texture.
        true_field: canonical to instance: exact correspondences of our own shapes, CPD for others.
    """

    category: Category
    name: str
    mesh: trimesh.Trimesh | trimesh.Scene
    true_field: DeformationField

    @property
    def solid(self) -> trimesh.Trimesh:
        """The geometry alone."""
        return self.mesh.to_mesh() if isinstance(self.mesh, trimesh.Scene) else self.mesh


def instances(categories: list[str], meshes: Path | None) -> Iterator[Instance]:
    """Test instances of the categories, or every mesh below `meshes/<category>/<name>/`."""
    for name in categories:
        category = load_category(name)
        if meshes is None:
            for test in category.test:
                yield Instance(category, test, category.instance_scene(test), category.field(test))
            continue
        for folder in sorted(path for path in (meshes / name).glob("*") if path.is_dir()):
            yield _from_folder(category, folder)


def _from_folder(category: Category, folder: Path) -> Instance:
    files = [folder / f"mesh{suffix}" for suffix in MESH_SUFFIXES if (folder / f"mesh{suffix}").is_file()]
    if not files:
        raise MeshError("holds no mesh", path=folder, choices=[f"mesh{suffix}" for suffix in MESH_SUFFIXES])
    mesh = trimesh.load(files[0], force="mesh")
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise MeshError("holds no triangles", path=files[0])
    from grasptransfer.benchmark.errors_of_shape import outer_surface

    space = category.shape_space
    cloud = outer_surface(mesh, 2000)
    field = cpd(space.control_points, cloud, beta=category.settings.beta, lam=category.settings.lam).field
    return Instance(category, folder.name, mesh, field)


def observe_instance(
    instance: Instance,
    view: int,
    *,
    views: int,
    renderer: Renderer,
    noise: PoseNoise | None = None,
    seed: int = 0,
) -> tuple[Observation, Float[np.ndarray, "4 4"]]:
    """Picture, depth and mask of an instance from one of the paper's 74 viewpoints, and the true pose.

    Args:
        view: index among `views` viewpoints spread evenly over the 74.
        noise: error of the told pose.
    """
    mesh = instance.mesh
    radius = float(np.linalg.norm(np.asarray(instance.solid.bounds), axis=1).max())
    distance = CAMERA.fy * 2 * radius / (FILL * CAMERA.height)
    index = round(view * 73 / max(views - 1, 1))
    pose = sphere_views(distance)[index]
    rng = np.random.default_rng([seed, index])
    picture = renderer.render(mesh, CAMERA, pose, lighting=draw_lighting(rng))
    background = Image.fromarray(draw_background(rng, [])).resize((CAMERA.width, CAMERA.height))
    told = noise.apply(pose, rng) if noise else pose
    mask = picture.mask
    observation = observe(
        picture.over(np.asarray(background)), told, camera=CAMERA, mask=mask, depth=picture.depth
    )
    return observation, pose
