"""How far a proposed pose is from the true one, where the object may look the same turned about its axis."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from grasptransfer.frames import invert, rotation_angle, transform_points
from grasptransfer.workshop.benchmark.errors_of_shape import outer_surface

STEP = 15  # degrees between turns about the upright axis that are tried
SAME = 0.015  # of the object's size: a turned surface that lies nearer to itself is the same
SURFACE_POINTS, GRID = 1500, 24


@dataclass(frozen=True)
class ProposalError:
    """Of one proposal, for the turn of a symmetric object that makes the angle least.

    Args:
        degrees: turn between the poses.
        metres: distance between the objects' origins.
        iou: intersection over union of the oriented bounding boxes.
        along_ray, across_ray: parts of the distance, as shares of that to the camera.
    """

    degrees: float
    metres: float
    iou: float
    along_ray: float
    across_ray: float

    def within(self, degrees: float, metres: float) -> bool:
        """Whether turn and distance are at most these."""
        return self.degrees <= degrees and self.metres <= metres

    def as_data(self) -> dict[str, float]:
        """Every number by its name."""
        return {name: round(float(value), 5) for name, value in vars(self).items()}


def symmetry_turns(mesh: trimesh.Trimesh) -> tuple[float, ...]:
    """Turns about the z axis [rad] after which the object's surface is where it was; 0 is always one."""
    points = np.asarray(outer_surface(mesh, SURFACE_POINTS))
    tree, limit = KDTree(points), SAME * float(mesh.extents.max())
    spacing = float(tree.query(points, 2)[0][:, 1].mean())
    turns = [0.0]
    for degrees in range(STEP, 360, STEP):
        turned = points @ _about_z(np.deg2rad(degrees)).T
        if float(tree.query(turned)[0].mean()) < limit + spacing / 2:
            turns.append(float(np.deg2rad(degrees)))
    return tuple(turns)


def pose_error(
    found: Float[np.ndarray, "4 4"],
    true: Float[np.ndarray, "4 4"],
    turns: tuple[float, ...],
    *,
    found_bounds: Float[np.ndarray, "2 3"],
    true_bounds: Float[np.ndarray, "2 3"],
) -> ProposalError:
    """Compare a proposal with the truth.

    Args:
        found, true: `camera_from_object` [m].
        turns: of `symmetry_turns`; all of them mean a body of revolution, whose turn does not count at all.
        found_bounds, true_bounds: corners of the bounding boxes of the reconstruction and the object [m].
    """
    if len(turns) == 360 // STEP:
        cosine = np.clip(found[:3, 2] @ true[:3, 2], -1, 1)
        angle = float(np.arccos(cosine))
        turn = _turn_about_z(found, true)
    else:
        angles = [rotation_angle(found[:3, :3].T @ true[:3, :3] @ _about_z(turn)) for turn in turns]
        angle, turn = min(angles), turns[int(np.argmin(angles))]
    same = true.copy()
    same[:3, :3] = true[:3, :3] @ _about_z(turn)
    distance = float(np.linalg.norm(true[:3, 3]))
    off, ray = found[:3, 3] - true[:3, 3], true[:3, 3] / distance
    along = abs(float(off @ ray))
    across = float(np.linalg.norm(off - (off @ ray) * ray))
    iou = _box_iou(found, found_bounds, same, true_bounds)
    return ProposalError(
        np.rad2deg(angle), float(np.linalg.norm(off)), iou, along / distance, across / distance
    )


def _turn_about_z(found: Float[np.ndarray, "4 4"], true: Float[np.ndarray, "4 4"]) -> float:
    """The turn of the true object about its axis that brings it nearest to the found one."""
    relative = true[:3, :3].T @ found[:3, :3]
    return float(np.arctan2(relative[1, 0] - relative[0, 1], relative[0, 0] + relative[1, 1]))


def _box_iou(a, bounds_a, b, bounds_b) -> float:
    share = _inside_share(a, bounds_a, b, bounds_b)
    volume_a, volume_b = (float(np.prod(bounds[1] - bounds[0])) for bounds in (bounds_a, bounds_b))
    common = share * volume_a
    return float(common / (volume_a + volume_b - common))


def _inside_share(a, bounds_a, b, bounds_b) -> float:
    """Share of box a that lies within box b."""
    points = _grid() * (bounds_a[1] - bounds_a[0]) + bounds_a[0]
    seen = transform_points(invert(b) @ a, points)
    return float(((seen > bounds_b[0]) & (seen < bounds_b[1])).all(1).mean())


@lru_cache(maxsize=1)
def _grid() -> Float[np.ndarray, "m 3"]:
    steps = (np.arange(GRID) + 0.5) / GRID
    return np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)


def _about_z(angle: float) -> Float[np.ndarray, "3 3"]:
    return Rotation.from_rotvec([0, 0, angle]).as_matrix()
