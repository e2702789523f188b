"""What stands around the object: obstacles and a support plane."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from grasptransfer.camera import Camera
from grasptransfer.data_files import read_yaml
from grasptransfer.errors import NOT_NUMBERS, PoseError, SceneError, in_millimetres
from grasptransfer.grasping.obstacles import checked_obstacle, depth_cloud
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
        obstacles: name, mesh or cloud in its own frame [m], `camera_from_obstacle` (4, 4) of each; a cloud
            is a trimesh `PointCloud` or an array (m, 3), and may show the object, too.
        support_plane: a point [m] and the normal towards the free side, camera frame; None: no plane.
        stands: the object stands on the plane: where its lowest points lie is then known, and says how far
            away the object is.
        stands_sigma: how sure that is, standard deviation of their height above the plane [m].

    Raises:
        SceneError: an obstacle that is none, two of one name, a plane that is none, or an object that stands
            on none.
        PoseError: an obstacle's pose is not rigid.
    """

    obstacles: Any = ()
    support_plane: Any = None
    stands: bool = False
    stands_sigma: float = STANDS_SIGMA

    def __post_init__(self):
        obstacles = tuple(checked_obstacle(given) for given in self.obstacles)
        names = [name for name, _, _ in obstacles]
        for name in names:
            if names.count(name) > 1:
                raise SceneError("two obstacles share a name", key="obstacles", value=name)
        object.__setattr__(self, "obstacles", obstacles)
        if self.support_plane is not None:
            object.__setattr__(self, "support_plane", _checked_plane(self.support_plane))
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
        point, normal = self.support_plane
        return Support(point, normal, self.stands_sigma)

    @staticmethod
    def of_depth(
        depth: Float[np.ndarray, "h w"],
        camera: Camera,
        *,
        without: Bool[np.ndarray, "h w"] | None = None,
        support_plane: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None = None,
    ) -> "Scene":
        """What a depth picture shows, as one obstacle; what lies on the reconstruction is the object's.

        Args:
            depth: along the optical axis [m]; 0 or not finite: missing.
            without: pixels that are left out, such as the object's and the robot's own.
            support_plane: as of a `Scene`.

        Raises:
            SceneError: the sizes differ, or no pixel is left.
        """
        cloud = depth_cloud(depth, camera, without=without)
        return Scene((("depth", cloud, np.eye(4)),), support_plane)


def _checked_plane(given: Any) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    try:
        point, normal = (np.array(part, dtype=float) for part in given)
        right = point.shape == normal.shape == (3,) and bool(np.isfinite([point, normal]).all())
    except NOT_NUMBERS:
        right = False
    if not right or np.linalg.norm(normal) < 1e-9:
        message = "must be a finite point and a normal that is not zero"
        raise SceneError(message, key="support_plane", value=str(given))
    if np.linalg.norm(point) > LARGEST_EXTENT:
        raise in_millimetres(SceneError, key="support_plane.point", value=point.tolist())
    return point, normal / np.linalg.norm(normal)


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
