"""The RGB-D estimator: what the picture says of shape and pose, and the measured depth on top.

The estimate from RGB, with some doubt, is the prior of latent and pose; each model point that is seen,
X = R (Z + mean + basis x) + t, should lie on the surface measured at its pixel:

    r = n . (X - P),   n the model's normal, P the point measured at X's pixel

Gauss-Newton on turn, shift and latent as in `pose_and_shape`. Depth may be missing or, on glass, that of
something behind: a loss that lets far residuals go (Geman and McClure), narrowed step by step (Blake and
Zisserman, Visual Reconstruction, 1987), keeps what fits. Without any depth the answer is that from RGB.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.rendering import Renderer

DEPTH_NOISE = 0.003  # m: of the camera, and of what the shape space cannot express
INDEPENDENT_POINTS = 60.0  # neighbouring points err together: all count as much as this many
WIDTHS = (0.04, 0.03, 0.02, 0.014, 0.010, 0.008)  # m: residuals beyond this are let go
STEPS = 3  # of Gauss-Newton at each width
HIDDEN = 0.006  # m: a model point this far behind the drawn model is hidden
LATENT_DOUBT = 6.0  # a picture errs in one way all over: its standard deviations are this much too small
FEWEST_POINTS = 20  # fewer fitting points say nothing


@dataclass(frozen=True)
class PoseDoubt:
    """How far the pose refined from RGB may still be wrong: standard deviations.

    Args:
        rotation: about each axis [rad].
        aside: across the line of sight, where the picture is sharp [m].
        along: the line of sight, where size and distance look alike [m].
    """

    rotation: float = np.deg2rad(1.5)
    aside: float = 0.004
    along: float = 0.020

    def precision(self, towards: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 6"]:
        """Of turn and shift, for an object in this direction, camera frame."""
        line = towards / np.linalg.norm(towards)
        precision = np.eye(6) / self.rotation**2
        precision[3:, 3:] = np.eye(3) / self.aside**2
        precision[3:, 3:] += np.outer(line, line) * (self.along**-2 - self.aside**-2)
        return precision


@dataclass(frozen=True)
class RgbdEstimator:
    """From RGB, depth where it is given, and an approximate pose to the shape.

    Args:
        rgb: gives the first estimate, with a latent and its covariance.
        renderer: for what the model would look like.
        refine_pose: fit the pose together with the shape.
        pose_doubt: how wrong the pose of the first estimate may be.
    """

    category: Category
    rgb: Estimator
    renderer: Renderer
    refine_pose: bool = True
    pose_doubt: PoseDoubt = PoseDoubt()

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Estimate from RGB, then correct latent and pose by the measured depth."""
        estimate = self.rgb(replace(observation, depth=None))
        if observation.depth is None or estimate.latent is None or estimate.latent_covariance is None:
            return estimate
        start = time.perf_counter()
        fused = self._fuse(estimate, observation)
        return replace(fused, timings=fused.timings | {"depth": time.perf_counter() - start})

    def _fuse(self, estimate: ShapeEstimate, observation: Observation) -> ShapeEstimate:
        space = self.category.shape_space
        assert estimate.latent is not None
        model = _Model(space.control_points, *space.displacement_model(space.control_points))
        fit = _Fit(model, estimate, self.pose_doubt if self.refine_pose else None)
        measured = _measured(observation, estimate.mask)
        for width in WIDTHS:
            drawn = self._draw(fit, observation)
            visible = fit.visible(drawn, observation.camera)
            for _ in range(STEPS):
                if not fit.step(drawn, visible, measured, observation.camera, width):
                    return estimate
        return replace(
            estimate,
            field=space.field(fit.latent),
            camera_from_object=fit.pose,
            latent=fit.latent,
            covariance=fit.covariance,
        )

    def _draw(self, fit: "_Fit", observation: Observation) -> "_Drawn":
        canonical = self.category.canonical
        vertices = self.category.shape_space.field(fit.latent)(np.asarray(canonical.vertices))
        mesh = trimesh.Trimesh(vertices, canonical.faces, process=False)
        depth = self.renderer.depth(mesh, observation.camera, fit.pose).astype(float)
        points = _unproject(observation, depth)
        normals = np.cross(*reversed(np.gradient(points, axis=(0, 1))))
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        return _Drawn(depth, normals / np.maximum(length, 1e-12))


@dataclass(frozen=True)
class _Model:
    """Canonical surface points and how the latent moves them [m]."""

    points: Float[np.ndarray, "n 3"]
    mean: Float[np.ndarray, "n 3"]
    basis: Float[np.ndarray, "n 3 k"]


@dataclass(frozen=True)
class _Drawn:
    """The model as it would be seen: depth [m] and unit normals, camera frame."""

    depth: Float[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"]


class _Fit:
    """Pose and latent, and the Gauss-Newton steps on them."""

    def __init__(self, model: _Model, estimate: ShapeEstimate, pose_doubt: PoseDoubt | None):
        assert estimate.latent is not None
        assert estimate.latent_covariance is not None
        self.model, self._prior_pose = model, estimate.camera_from_object
        self.pose, self.latent = self._prior_pose.copy(), estimate.latent.copy()
        size = 6 + len(self.latent)
        self._free = slice(0, None) if pose_doubt is not None else slice(6, None)
        self._precision = np.zeros((size, size))
        self._precision[6:, 6:], self._prior_latent = _doubted(estimate.latent, estimate.latent_covariance)
        if pose_doubt is not None:
            self._precision[:6, :6] = pose_doubt.precision(self._prior_pose[:3, 3])
        self.covariance = np.zeros((size, size))

    def visible(self, drawn: _Drawn, camera: Camera) -> Int[np.ndarray, "s"]:
        """Indices of the model points that are seen where the model is drawn."""
        seen = self._shaped() @ self.pose[:3, :3].T + self.pose[:3, 3]
        columns, rows, inside = _pixels(seen, camera)
        depth = drawn.depth[rows, columns]
        return np.flatnonzero(inside & (depth > 0) & (np.abs(seen[:, 2] - depth) < HIDDEN))

    def step(
        self,
        drawn: _Drawn,
        visible: Int[np.ndarray, "s"],
        measured: Float[np.ndarray, "h w"],
        camera: Camera,
        width: float,
    ) -> bool:
        """One step; False where too little of the depth fits."""
        turned = self._shaped()[visible] @ self.pose[:3, :3].T
        columns, rows, inside = _pixels(turned + self.pose[:3, 3], camera)
        kept = inside & (measured[rows, columns] > 0) & (drawn.depth[rows, columns] > 0)
        turned, columns, rows, basis = (
            turned[kept],
            columns[kept],
            rows[kept],
            self.model.basis[visible][kept],
        )
        pixels = np.stack([columns, rows], -1).astype(float)
        normals = drawn.normals[rows, columns]
        away = turned + self.pose[:3, 3] - camera.unproject(pixels, measured[rows, columns])
        residual = (away * normals).sum(1)
        fitting = 1 / np.square(1 + np.square(residual / width))
        if fitting.sum() < FEWEST_POINTS:
            return False
        by_turn = np.cross(turned, normals)  # n . (w x p) = w . (p x n)
        by_latent = np.einsum("pi,ij,pjk->pk", normals, self.pose[:3, :3], basis)
        weight = fitting / DEPTH_NOISE**2 * min(1.0, INDEPENDENT_POINTS / fitting.sum())
        self._advance(np.concatenate([by_turn, normals, by_latent], axis=1), weight, residual)
        return True

    def _shaped(self) -> Float[np.ndarray, "n 3"]:
        return self.model.points + self.model.mean + self.model.basis @ self.latent

    def _advance(self, jacobian, weight, residual):
        drift = np.concatenate(
            [
                Rotation.from_matrix(self.pose[:3, :3] @ self._prior_pose[:3, :3].T).as_rotvec(),
                self.pose[:3, 3] - self._prior_pose[:3, 3],
                self.latent - self._prior_latent,
            ]
        )
        rows = jacobian * weight[:, None]
        free = self._free
        hessian = (rows.T @ jacobian + self._precision)[free, free]
        self.covariance[free, free] = np.linalg.inv(hessian)
        step = np.zeros(len(drift))
        step[free] = -self.covariance[free, free] @ (rows.T @ residual + self._precision @ drift)[free]
        self.pose[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ self.pose[:3, :3]
        self.pose[:3, 3] += step[3:6]
        self.latent = self.latent + step[6:]


def _doubted(
    latent: Float[np.ndarray, "k"], covariance: Float[np.ndarray, "k k"]
) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k"]]:
    """Precision and mean of the latent with the picture believed less, and the prior x ~ N(0, I) as ever."""
    known = np.linalg.inv(covariance)
    prior = np.eye(len(latent))
    precision = prior + (known - prior) / LATENT_DOUBT**2
    return precision, np.linalg.solve(precision, known @ latent / LATENT_DOUBT**2)


def _pixels(
    seen: Float[np.ndarray, "n 3"], camera: Camera
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Columns and rows of points in the camera's frame, and which lie in the picture."""
    columns, rows = np.round(camera.project(seen)).astype(int).T
    inside = (columns >= 0) & (rows >= 0) & (columns < camera.width) & (rows < camera.height)
    return np.where(inside, columns, 0), np.where(inside, rows, 0), inside


def _measured(observation: Observation, predicted: np.ndarray | None) -> Float[np.ndarray, "h w"]:
    """Depth on the object: within the told mask, or else the predicted one [m]."""
    assert observation.depth is not None
    mask = predicted if observation.mask is None else observation.mask
    depth = np.asarray(observation.depth, float)
    return depth if mask is None else np.where(mask, depth, 0.0)


def _unproject(observation: Observation, depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    return observation.camera.unproject(np.stack([u, v], -1).astype(float), depth)
