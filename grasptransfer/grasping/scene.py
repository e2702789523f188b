"""What stands around the object: obstacles and a support plane."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import PoseError, SceneError, in_millimetres
from grasptransfer.frames import check_rigid
from grasptransfer.grasping.surface import LARGEST_EXTENT
from grasptransfer.meshes import MeshLimits, load_mesh
from grasptransfer.perception.standing import Support
from grasptransfer.yaml_models import Strict, parse

if TYPE_CHECKING:
    import trimesh

STANDS_SIGMA = 0.003  # m: of a plane fitted to the depth of a table, or measured by touching it
SUREST, VAGUEST = 1e-5, 1.0  # m
Triple = tuple[float, float, float]

OBSTACLE = MeshLimits(largest=LARGEST_EXTENT, sheets=True)


@dataclass(frozen=True)
class Scene:
    """Everything a gripper must not touch, apart from the object itself.

    Args:
        obstacles: name, mesh in its own frame [m], `camera_from_obstacle` (4, 4) of each.
        support_plane: a point [m] and the normal towards the free side, camera frame; None: no plane.
        stands: the object stands on the plane: where its lowest points lie is then known, and says how far
            away the object is.
        stands_sigma: how sure that is, standard deviation of their height above the plane [m].

    Raises:
        SceneError: two obstacles of one name, a plane that is none, or an object that stands on none.
        PoseError: an obstacle's pose is not rigid.
    """

    obstacles: "tuple[tuple[str, trimesh.Trimesh, np.ndarray], ...]" = ()
    support_plane: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None = field(default=None)
    stands: bool = False
    stands_sigma: float = STANDS_SIGMA

    def __post_init__(self):
        names = [name for name, _, _ in self.obstacles]
        for name in names:
            if names.count(name) > 1:
                raise SceneError("two obstacles share a name", key="obstacles", value=name)
        checked = tuple(
            (name, mesh, check_rigid(pose, f"obstacles.{name}.camera_from_obstacle"))
            for name, mesh, pose in self.obstacles
        )
        for name, mesh, _ in checked:
            _check_size(name, mesh)
        object.__setattr__(self, "obstacles", checked)
        if self.support_plane is not None:
            point, normal = (np.asarray(part, dtype=float) for part in self.support_plane)
            finite = np.isfinite(point).all() and np.isfinite(normal).all()
            if point.shape != (3,) or normal.shape != (3,) or not finite or np.linalg.norm(normal) < 1e-9:
                raise SceneError(
                    "must be a finite point and a normal that is not zero",
                    key="support_plane",
                    value=[point.tolist(), normal.tolist()],
                )
            if np.linalg.norm(point) > LARGEST_EXTENT:
                raise in_millimetres(SceneError, key="support_plane.point", value=point.tolist())
            object.__setattr__(self, "support_plane", (point, normal / np.linalg.norm(normal)))
        if self.stands and self.support_plane is None:
            raise SceneError("needs a support_plane to stand on", key="stands", value=self.stands)
        if not SUREST <= self.stands_sigma <= VAGUEST:
            raise SceneError(
                f"must lie between {SUREST} and {VAGUEST} m", key="stands_sigma", value=self.stands_sigma
            )

    @property
    def support(self) -> Support | None:
        """What is known of where the object stands; None where nothing is said of it."""
        if not self.stands or self.support_plane is None:
            return None
        return Support(*self.support_plane, self.stands_sigma)


def _check_size(name: str, mesh: "trimesh.Trimesh"):
    size = float(np.max(mesh.extents))
    if size > LARGEST_EXTENT:
        raise in_millimetres(SceneError, key=f"obstacles.{name}", value=f"{size:g} long")


class _ObstacleModel(Strict):
    mesh: str | None = None
    box: Triple | None = None
    camera_from_obstacle: tuple[tuple[float, float, float, float], ...]


class _PlaneModel(Strict):
    point: Triple
    normal: Triple


class _SceneModel(Strict):
    obstacles: Mapping[str, _ObstacleModel] = {}
    support_plane: _PlaneModel | None = None
    stands: bool = False
    stands_sigma: float = STANDS_SIGMA


def load_scene(path: str | Path) -> Scene:
    """Read a scene.

    A YAML mapping: `support_plane: {point, normal}`, `stands` and `stands_sigma`; `obstacles: {name: {mesh or
    box, camera_from_obstacle}}`, mesh files relative to the YAML, boxes by their extents; all in metres.

    Raises:
        SceneError: a mistake in it, named by file, key, value and choices.
    """
    path = Path(path)
    model = parse(_SceneModel, read_yaml(path, error=SceneError), path, error=SceneError)
    try:
        obstacles = tuple(
            (name, _mesh(name, obstacle, path), np.array(obstacle.camera_from_obstacle))
            for name, obstacle in model.obstacles.items()
        )
        plane = model.support_plane
        support = None if plane is None else (np.array(plane.point), np.array(plane.normal))
        return Scene(obstacles, support, model.stands, model.stands_sigma)
    except (PoseError, SceneError) as error:
        if error.path is not None:
            raise
        raise error.at(path, kind=SceneError) from error


def as_scene(scene: object) -> Scene | None:
    """A scene, or the path of one; None stays None.

    Raises:
        SceneError: a mistake in the file, or neither.
    """
    if isinstance(scene, str | Path):
        return load_scene(scene)
    if scene is None or isinstance(scene, Scene):
        return scene
    raise SceneError("must be a Scene or the path of a scene YAML", key="scene", value=type(scene).__name__)


def _mesh(name: str, model: _ObstacleModel, path: Path) -> "trimesh.Trimesh":
    import trimesh

    key = f"obstacles.{name}"
    if (model.mesh is None) == (model.box is None):
        raise SceneError("needs either mesh or box", path=path, key=key, choices=("mesh", "box"))
    if model.box is not None:
        if min(model.box) <= 0:
            raise SceneError("must be positive", path=path, key=f"{key}.box", value=list(model.box))
        return trimesh.creation.box(extents=model.box)
    file = path.parent / str(model.mesh)
    return load_mesh(file, limits=OBSTACLE, error=SceneError, key=f"{key}.mesh")
