"""How likely each grasp is to hold, over the shapes and poses that the picture leaves possible.

The posterior of the shape is Gaussian in the latent, and displacements are linear in it: surface
points of a plausible instance are `mean + basis x`, with no new field to evaluate. The pose is drawn
around the estimate as well. For every draw the points near each opened gripper tell its clearance,
what the pads meet, how flat, and how hard the weight turns the object between them; a logistic model
turns that into a chance of holding, and the score is the mean over the draws.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.frames import invert, transform_points
from grasptransfer.grasping.collision import CheckStatus, GraspCheck
from grasptransfer.grasping.gripper import Gripper
from grasptransfer.grasping.surface import Surface
from grasptransfer.grasping.warping import WarpedGrasp

if TYPE_CHECKING:
    import trimesh

    from grasptransfer.category import Category
    from grasptransfer.perception.estimate import ShapeEstimate

SURFACE_POINTS = 3000  # about 4 mm apart on a mug: some ten under each pad
NEAR = 0.012  # m around the gripper: points farther away stay out of its reach in every draw
MASS_LIMITS = (0.05, 1.0)  # kg, as the simulation protocols clamp it
UP = np.array([0.0, 0.0, 1.0])  # object frame: categories stand upright
TILT = np.deg2rad(30)  # how far a held object is turned about the closing line, both ways
FEATURES = 4
PATCH = 0.0025  # m behind the first point that a pad meets: one spacing of the points on a curved side

Features = Float[np.ndarray, "s 4"]


@dataclass(frozen=True)
class Ranking:
    """Settings of the ranking.

    Args:
        draws: shapes and poses per call.
        pose_shift, pose_turn: standard deviation of the pose along each axis [m, rad].
        density: of the object [kg/m3], the simulation protocols' guess.
        bias, clearance, flatness, coverage, moment: logistic model, fitted to simulated grasps by
            `grasptransfer bench calibration`; of the features below.
        least_chance: a grasp that the gripper reaches is unusable below this score.

    The features of a draw: clearance in mm (between -3 and 3), flatness as a cosine, coverage as a share
    of a pad's points, moment in kg cm: how hard the weight turns the object about the closing line while
    the hand tilts it by up to `TILT`. What hangs straight below the pads has little of it; what lies beside
    them has all, and a closing line that stands upright has none.
    """

    draws: int = 16
    pose_shift: float = 0.002
    pose_turn: float = 0.03
    bias: float = 0.4
    clearance: float = 0.4
    flatness: float = 0.45
    coverage: float = 2.3
    moment: float = -1.8
    density: float = 500.0
    least_chance: float = 0.65

    @property
    def weights(self) -> Float[np.ndarray, "5"]:
        """Bias, then the weight of each feature."""
        return np.array([self.bias, self.clearance, self.flatness, self.coverage, self.moment])


def rank_grasps(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    mesh: "trimesh.Trimesh",
    category: "Category | None" = None,
    estimate: "ShapeEstimate | None" = None,
    seed: int = 0,
    settings: Ranking | None = None,
) -> tuple[float, ...]:
    """Expected success of each grasp in [0, 1]; 0 for those that failed their check.

    Args:
        grasps: on the instance, object frame.
        checks: their checks.
        mesh: the reconstruction, object frame [m].
        category, estimate: whose posterior the shapes are drawn from; without them only the pose varies.
        seed: of the draws; they are the same for all grasps.
    """
    settings = Ranking() if settings is None else settings
    features = grasp_features(
        grasps, checks, gripper, mesh=mesh, category=category, estimate=estimate, seed=seed, settings=settings
    )
    return tuple(
        expected_success(each, settings.weights) if check.usable else 0.0
        for each, check in zip(features, checks, strict=True)
    )


def grasp_features(
    grasps: Sequence[WarpedGrasp],
    checks: Sequence[GraspCheck],
    gripper: Gripper,
    *,
    mesh: "trimesh.Trimesh",
    category: "Category | None" = None,
    estimate: "ShapeEstimate | None" = None,
    seed: int = 0,
    settings: Ranking,
) -> list[Features]:
    """What the ranking looks at, for each usable grasp and draw; NaN where a pad meets nothing.

    Unusable grasps get no rows. Arguments as of `rank_grasps`.
    """
    if not any(check.usable for check in checks):
        return [np.zeros((0, FEATURES)) for _ in grasps]
    cloud = _Cloud.draw(mesh, category, estimate, settings, np.random.default_rng(seed))
    return [
        _features(grasp, check.opening, gripper, cloud) if check.usable else np.zeros((0, FEATURES))
        for grasp, check in zip(grasps, checks, strict=True)
    ]


def expected_success(features: Features, weights: Float[np.ndarray, "5"]) -> float:
    """Mean chance of holding over the draws; a draw in which a pad meets nothing has none."""
    chance = 1 / (1 + np.exp(-(weights[0] + features @ weights[1:])))
    return float(np.nan_to_num(chance, nan=0.0).mean())


def doubt_unlikely(
    checks: Sequence[GraspCheck], scores: Sequence[float], *, least_chance: float = Ranking.least_chance
) -> list[GraspCheck]:
    """The checks, with grasps that are reached but unlikely to hold made unusable, and the reason why."""
    return [
        replace(check, status=CheckStatus.UNLIKELY_TO_HOLD, reason=_doubt(score))
        if check.usable and score < least_chance
        else check
        for check, score in zip(checks, scores, strict=True)
    ]


def _doubt(score: float) -> str:
    return f"expected success {score:.0%} over the shapes and poses that the picture leaves possible"


@dataclass(frozen=True)
class _Cloud:
    """Surface points of the reconstruction, and how each draw moves them.

    Args:
        points, normals: (m, 3) object frame [m].
        shifts: (s, m, 3) of each draw's shape [m].
        motions: (s, 4, 4) of each draw's pose, `drawn_from_object`.
        centre: (3,) centre of mass [m].
        mass: kg.
    """

    points: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    shifts: Float[np.ndarray, "s m 3"]
    motions: Float[np.ndarray, "s 4 4"]
    centre: Float[np.ndarray, "3"]
    mass: float

    @staticmethod
    def draw(
        mesh: "trimesh.Trimesh",
        category: "Category | None",
        estimate: "ShapeEstimate | None",
        settings: Ranking,
        rng: np.random.Generator,
    ) -> "_Cloud":
        import trimesh
        from scipy.spatial.transform import Rotation

        sampled = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)
        points, faces = np.asarray(sampled[0]), np.asarray(sampled[1])
        shifts = np.zeros((settings.draws, *points.shape))
        if category is not None and estimate is not None and estimate.latent_covariance is not None:
            corners = np.asarray(mesh.triangles[faces])
            weights = trimesh.triangles.points_to_barycentric(corners, points)
            vertices = np.asarray(category.canonical.vertices)[np.asarray(mesh.faces)[faces]]
            points_canonical = np.einsum("mc,mci->mi", weights, vertices)
            _, basis = category.shape_space.displacement_model(points_canonical)
            covariance = estimate.latent_covariance
            latents = rng.multivariate_normal(np.zeros(len(covariance)), covariance, settings.draws)
            shifts = np.einsum("mik,sk->smi", basis, latents)
        motions = np.tile(np.eye(4), (settings.draws, 1, 1))
        turns = rng.normal(size=(settings.draws, 3)) * settings.pose_turn
        motions[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
        motions[:, :3, 3] = rng.normal(size=(settings.draws, 3)) * settings.pose_shift
        closed = Surface(mesh).mesh
        solid = closed if closed.is_watertight else closed.convex_hull
        mass = float(np.clip(settings.density * abs(solid.volume), *MASS_LIMITS))
        centre = np.asarray(solid.center_mass)
        return _Cloud(points, mesh.face_normals[faces], shifts, motions, centre, mass)


def _features(grasp: WarpedGrasp, opening: float, gripper: Gripper, cloud: _Cloud) -> Features:
    """Clearance, flatness, coverage and moment in each draw; NaN where a pad meets nothing."""
    gripper_from_object = invert(grasp.object_from_gripper)
    boxes = _boxes(gripper, opening)
    local = transform_points(gripper_from_object, cloud.points)
    pads = _pad_corridor(gripper, opening, grasp.width)
    near = (_distances(local, boxes) < NEAR) | _within(local, pads, NEAR)
    moved = cloud.points[near] + cloud.shifts[:, near]
    moved = np.einsum("sij,smj->smi", cloud.motions[:, :3, :3], moved) + cloud.motions[:, None, :3, 3]
    moved = transform_points(gripper_from_object, moved)
    normals = np.einsum("sij,mj->smi", cloud.motions[:, :3, :3], cloud.normals[near])
    closing = normals @ grasp.object_from_gripper[:3, 0]
    draws = len(moved)
    clearance = np.full(draws, 0.003)
    if moved.shape[1]:
        distances = _distances(moved.reshape(-1, 3), boxes).reshape(draws, -1)
        clearance = distances.min(axis=1)
    between = _within(moved, pads, 0.0)
    touched = np.stack([_touched(moved[..., 0], between, side) for side in (-1, 1)], axis=1)
    count = touched.sum(axis=2)
    cosines = np.stack([-closing, closing], axis=1)
    # Each pad's points face it: towards -x those of the -x pad, towards +x those of the other.
    flat = np.where(touched, cosines, 0).sum(axis=2) / np.maximum(count, 1)
    columns = [
        np.clip(clearance * 1e3, -3, 3),
        flat.min(axis=1),
        np.minimum(count.min(axis=1) / 4, 1),
        np.full(draws, cloud.mass * _lever(grasp, cloud) * 100),
    ]
    return np.where(count.min(axis=1)[:, None] > 0, np.stack(columns, axis=1), np.nan)


def _lever(grasp: WarpedGrasp, cloud: _Cloud) -> float:
    """Lever of the weight about the line between the pads, in the worst tilt about that line [m]."""
    rotation = grasp.object_from_gripper[:3, :3]
    beside = (rotation.T @ (cloud.centre - grasp.object_from_gripper[:3, 3]))[1:]
    upright = (rotation.T @ UP)[1:]
    angle = np.arctan2(abs(beside[0] * upright[1] - beside[1] * upright[0]), abs(beside @ upright))
    worst = np.sin(min(angle + TILT, np.pi / 2))
    return float(np.linalg.norm(beside) * np.linalg.norm(upright) * worst)


def _touched(x: Float[np.ndarray, "s m"], between: np.ndarray, side: int) -> np.ndarray:
    """Points that a pad coming from `side` (-1 or 1) meets first, in every draw."""
    reach = np.where(between, side * x, -np.inf)
    first = reach.max(axis=1, initial=-np.inf, keepdims=True)
    return between & (reach > first - PATCH)


def _boxes(gripper: Gripper, opening: float) -> list[tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]]:
    """Every part of the opened gripper as a box: `box_from_gripper` and half its size [m]."""
    poses = gripper.link_poses(opening)
    boxes = []
    for link in gripper.links:
        for shape in link.shapes if link.collision is not None else ():
            gripper_from_shape = poses[link.name] @ shape.link_from_shape
            low, high = np.asarray(shape.mesh.bounds)
            middle = np.eye(4)
            middle[:3, 3] = (low + high) / 2
            boxes.append((invert(gripper_from_shape @ middle), (high - low) / 2))
    return boxes


def _distances(points: Float[np.ndarray, "m 3"], boxes: list) -> Float[np.ndarray, "m"]:
    """Signed distance to the nearest box [m], negative inside."""
    nearest = np.full(len(points), np.inf)
    rows = np.ascontiguousarray(points.T)
    for box_from_gripper, half in boxes:
        # Component by component: numpy reduces short axes slowly.
        x, y, z = np.abs(box_from_gripper[:3, :3] @ rows + box_from_gripper[:3, 3:]) - half[:, None]
        inside = np.minimum(np.maximum(np.maximum(x, y), z), 0)
        x, y, z = np.maximum(x, 0), np.maximum(y, 0), np.maximum(z, 0)
        np.minimum(nearest, np.sqrt(x * x + y * y + z * z) + inside, out=nearest)
    return nearest


def _pad_corridor(
    gripper: Gripper, opening: float, width: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The box between the pads that they sweep when closing: its low and high corner [m]."""
    height = float(gripper.pad_heights(np.array([width])).mean())
    size = np.minimum(gripper.pads[0].size, gripper.pads[1].size)
    low = np.array([-opening / 2, -size[0] / 2, height - size[1] / 2])
    high = np.array([opening / 2, size[0] / 2, height + size[1] / 2])
    return low, high


def _within(points: np.ndarray, corners: tuple, margin: float) -> np.ndarray:
    low, high = corners
    inside = np.ones(points.shape[:-1], dtype=bool)
    for axis in range(3):
        inside &= (points[..., axis] > low[axis] - margin) & (points[..., axis] < high[axis] + margin)
    return inside
