"""Instances whose shape is known, and pictures of them: the input of the benchmarks."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Float32
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.category import Category, load_category
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import VIEWPOINTS, sphere_views
from grasptransfer.errors import MeshError, SettingsError
from grasptransfer.frames import invert, rigid
from grasptransfer.meshes import load_mesh
from grasptransfer.perception.observation import Observation, observe
from grasptransfer.registration import DeformationField, cpd
from grasptransfer.workshop import objects
from grasptransfer.workshop.benchmark.given_poses import GivenPoses
from grasptransfer.workshop.building.parametric.canonical_surface import CanonicalPoints, surface_of
from grasptransfer.workshop.building.parametric.space_choice import fit_weights
from grasptransfer.workshop.training.backgrounds import draw_backdrop
from grasptransfer.workshop.training.scenes import PoseNoise, draw_lighting

CAMERA = Camera.from_fov(640, 480, np.deg2rad(60))
APART = np.deg2rad(45)  # from each picture of one object to the next
FILL = 0.55  # The object covers this share of the picture's height.
MESH_SUFFIXES = (".glb", ".obj", ".ply", ".off", ".stl")
RANDOM = "random_"  # before the seed, in the names of shapes that are drawn when asked for


@dataclass(frozen=True)
class Instance:
    """An instance that no training saw.

    Args:
        mesh: object frame [m], with its texture.
        truth: the true field, or what finds it once it is asked for.
        exact: whether the field is exact.
    """

    category: Category
    name: str
    mesh: trimesh.Trimesh | trimesh.Scene
    truth: DeformationField | Callable[[], DeformationField]
    exact: bool = False

    @cached_property
    def true_field(self) -> DeformationField:
        """Canonical to instance: exact correspondences of our own shapes, CPD for others."""
        return self.truth if isinstance(self.truth, DeformationField) else self.truth()

    @cached_property
    def solid(self) -> trimesh.Trimesh:
        """The geometry alone."""
        return self.mesh.to_mesh() if isinstance(self.mesh, trimesh.Scene) else self.mesh


def instances(categories: list[str], meshes: Path | None) -> Iterator[Instance]:
    """Test instances of the categories, or every mesh below `meshes/<category>/<name>/`."""
    for category in categories:
        for name in instance_names(category, meshes):
            yield load_instance(category, name, meshes)


def instance_names(category: str, meshes: Path | None) -> list[str]:
    """Names of the shipped test instances, or of the folders below `meshes/<category>/`."""
    if meshes is None:
        return list(load_category(category).test)
    return sorted(path.name for path in (meshes / load_category(category).name).glob("*") if path.is_dir())


def random_names(objects: int, first_seed: int) -> list[str]:
    """Names of random shapes, for `load_instance`.

    Raises:
        SettingsError: fewer than one.
    """
    if objects < 1:
        raise SettingsError("must be at least 1", key="objects", value=objects)
    return [f"{RANDOM}{first_seed + number}" for number in range(objects)]


def load_instance(category: str, name: str, meshes: Path | None = None) -> Instance:
    """One of `instance_names` or `random_names`, with the field that leads to it."""
    loaded = _load_category(category)
    if name.startswith(RANDOM):
        return _random(loaded, name)
    if meshes is None:
        return Instance(loaded, name, loaded.instance_scene(name), loaded.field(name), exact=True)
    return _from_folder(loaded, meshes / loaded.name / name)


@lru_cache(maxsize=8)
def _load_category(name: str) -> Category:
    return load_category(name)


def _from_folder(category: Category, folder: Path) -> Instance:
    files = [folder / f"mesh{suffix}" for suffix in MESH_SUFFIXES if (folder / f"mesh{suffix}").is_file()]
    if not files:
        raise MeshError("holds no mesh", path=folder, choices=[f"mesh{suffix}" for suffix in MESH_SUFFIXES])
    mesh = load_mesh(files[0])
    return Instance(category, folder.name, mesh, lambda: _registered(category, mesh))


def _registered(category: Category, mesh: trimesh.Trimesh | trimesh.Scene) -> DeformationField:
    """CPD's field from the canonical model to another mesh."""
    from grasptransfer.workshop.benchmark.errors_of_shape import outer_surface

    space, settings = category.shape_space, category.settings
    # The kernel of exact correspondences is too narrow for CPD: points would slide along the surface.
    beta, lam = (category.file.measured.get(key) for key in ("cpd_beta", "cpd_lambda"))
    beta = beta if isinstance(beta, int | float) else settings.beta
    lam = lam if isinstance(lam, int | float) else settings.lam
    points = outer_surface(mesh, 2000)  # pyright: ignore[reportArgumentType]
    return cpd(space.control_points, points, beta=beta, lam=lam).field


def _random(category: Category, name: str) -> Instance:
    shape = objects.sample(category.name, int(name.removeprefix(RANDOM)))
    space, surface = category.shape_space, _surface(category.name)
    moved = surface.displacements(shape)[None]
    weights = fit_weights(surface.points, space, category.settings.lam, moved)[0]
    field = DeformationField(space.control_points, weights, space.beta, space.centre, space.scale)
    return Instance(category, name, shape.scene(), field, exact=True)


@lru_cache(maxsize=8)
def _surface(category: str) -> CanonicalPoints:
    return surface_of(objects.canonical(category))


def viewpoints_of(name: str, views: int) -> list[int]:
    """Viewpoints of an instance: the same for all instances, but for each random shape the next ones."""
    return spread_views(views, start=views * int(name.removeprefix(RANDOM)) if name.startswith(RANDOM) else 0)


def spread_views(views: int, *, start: int = 0) -> list[int]:
    """Indices of viewpoints that stand for all 74: every side and height, the poles as rarely as they are.

    Args:
        views: how many.
        start: how many come before them in the order in which few stand for all.

    Raises:
        SettingsError: not 1 to 74 of them.
    """
    if not 1 <= views <= VIEWPOINTS:
        raise SettingsError(f"must lie between 1 and {VIEWPOINTS}", key="views", value=views)
    # 29 has no divisor in common with 74, and a stride of 29 turns by 5/12 and climbs by 2.4 rings.
    return sorted((view * 29 + 17) % VIEWPOINTS for view in range(start, start + views))


@dataclass(frozen=True)
class Sight:
    """An instance as a camera sees it.

    Args:
        observation: picture, exact depth and mask, and the given pose.
        pose: the true `camera_from_object`.
        coverage: (h, w) how opaque the object is, in [0, 1].
    """

    observation: Observation
    pose: Float[np.ndarray, "4 4"]
    coverage: Float32[np.ndarray, "h w"]


def observe_instance(
    instance: Instance,
    viewpoint: int,
    *,
    renderer: Renderer,
    noise: PoseNoise | GivenPoses | None = None,
    seed: int = 0,
    pictures: int = 1,
) -> tuple[Observation, Float[np.ndarray, "4 4"]]:
    """Picture, depth and mask of an instance, and the true pose; arguments as of `see_instance`.

    Args:
        instance, viewpoint, renderer, noise, seed, pictures: as for `see_instance`.
    """
    how = {"renderer": renderer, "noise": noise, "seed": seed, "pictures": pictures}
    sight = see_instance(instance, viewpoint, **how)
    return sight.observation, sight.pose


def see_instance(
    instance: Instance,
    viewpoint: int,
    *,
    renderer: Renderer,
    noise: PoseNoise | GivenPoses | None = None,
    seed: int = 0,
    pictures: int = 1,
) -> Sight:
    """What a camera sees of an instance from one of the paper's 74 viewpoints.

    Args:
        viewpoint: its index, from 0.
        noise: error of the given pose; `GivenPoses` also say how sure it is.
        seed: seed of light, background and pose error, which differ between viewpoints.
        pictures: how many pictures the observation holds: the camera goes sideways around the object, by
            `APART` from each to the next. One error of the pose is common to all; light and background are
            not.
    """
    radius = float(np.linalg.norm(np.asarray(instance.solid.bounds), axis=1).max())
    distance = CAMERA.fy * 2 * radius / (FILL * CAMERA.height)
    pose = sphere_views(distance)[viewpoint]
    rng = np.random.default_rng([seed, viewpoint])
    sight = _see(instance, pose, None, renderer=renderer, noise=noise, rng=rng)
    given, further = sight.observation.camera_from_object, []
    for number in range(1, pictures):
        moved = pose @ rigid(around(pose, number * APART), np.zeros(3))
        rng = np.random.default_rng([seed, viewpoint, number])
        seen = _see(instance, moved, moved @ invert(pose) @ given, renderer=renderer, noise=noise, rng=rng)
        further.append(seen.observation)
    return replace(sight, observation=replace(sight.observation, further=tuple(further)))


def around(pose: Float[np.ndarray, "4 4"], angle: float) -> Float[np.ndarray, "3 3"]:
    """The turn of the object that looks like a camera's way around it, to the side.

    Args:
        pose: (4, 4) `camera_from_object` [m].
        angle: of the way around [rad].
    """
    return Rotation.from_rotvec(angle * pose[1, :3]).as_matrix()


def _see(
    instance: Instance,
    pose: Float[np.ndarray, "4 4"],
    given: Float[np.ndarray, "4 4"] | None,
    *,
    renderer: Renderer,
    noise: PoseNoise | GivenPoses | None,
    rng: np.random.Generator,
) -> Sight:
    """From this pose; where no given pose is, one is drawn."""
    picture = renderer.render(instance.mesh, CAMERA, pose, lighting=draw_lighting(rng))
    background = draw_backdrop(rng, CAMERA.width, CAMERA.height)
    if given is None:
        given = noise.apply(pose, rng) if noise else pose
    observation = observe(
        picture.over(background),
        given,
        camera=CAMERA,
        mask=picture.mask,
        depth=picture.depth,
        pose_sigma=noise.pose_sigma if isinstance(noise, GivenPoses) else None,
    )
    return Sight(observation, pose, picture.alpha)
