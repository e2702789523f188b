"""Estimators to compare with: no deformation, size only, and the two that need a depth picture."""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar

from grasptransfer.category import Category
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.errors import ImageError
from grasptransfer.frames import invert, transform_points
from grasptransfer.perception.estimate import EstimateStatus, ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.registration import CpdStatus, DeformationField, LatentFitStatus, cpd, latent_fit

FEWEST_POINTS = 20
MOST_POINTS = 1500  # of a depth cloud; more cost time and add nothing at this noise


_STATUS = {
    LatentFitStatus.CONVERGED: EstimateStatus.OK,
    LatentFitStatus.ITERATION_LIMIT: EstimateStatus.NOT_CONVERGED,
    LatentFitStatus.POOR_FIT: EstimateStatus.OUT_OF_CATEGORY,
}
_CPD_STATUS = {
    CpdStatus.CONVERGED: EstimateStatus.OK,
    CpdStatus.VARIANCE_FLOOR: EstimateStatus.OK,
    CpdStatus.ITERATION_LIMIT: EstimateStatus.NOT_CONVERGED,
    CpdStatus.STOPPED: EstimateStatus.NOT_CONVERGED,
}
SCALES = 0.3, 3.0  # that `similarity` looks for


@dataclass(frozen=True)
class RigidEstimator:
    """No deformation: the instance is taken for the canonical model."""

    category: Category

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """The identity field."""
        return ShapeEstimate(_uniform_scale(self.category, 1.0), observation.camera_from_object)


@dataclass(frozen=True)
class SimilarityEstimator:
    """Size only: the canonical model scaled until its projection has the size of the object's box."""

    category: Category

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """The uniform scale whose projected extents fit the told box best.

        Raises:
            ImageError: the observation has neither mask nor box.
        """
        if observation.box is None:
            raise ImageError("estimator 'similarity' needs a mask or a box", key="mask", value=None)
        vertices = np.asarray(self.category.canonical.vertices)
        wanted = _extent(observation.box)

        def misfit(log_scale: float) -> float:
            box = projected_box(
                vertices * np.exp(log_scale), observation.camera, observation.camera_from_object
            )
            return float(np.square(np.log(_extent(box) / wanted)).sum())

        lowest, highest = np.log(SCALES)
        best = minimize_scalar(misfit, bounds=(lowest, highest), method="bounded")
        at_bound = min(best.x - lowest, highest - best.x) < 1e-3
        return ShapeEstimate(
            _uniform_scale(self.category, float(np.exp(best.x))),
            observation.camera_from_object,
            status=EstimateStatus.NOT_CONVERGED if at_bound else EstimateStatus.OK,
        )


@dataclass(frozen=True)
class ClsEstimator:
    """Shape space fitted to the depth cloud (Rodriguez et al. 2018, the paper's CLS)."""

    category: Category
    refine_pose: bool = False

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Fit the latent, and the pose where asked, to the observed points."""
        start = time.perf_counter()
        cloud = depth_cloud(observation)
        viewpoint = invert(observation.camera_from_object)[:3, 3]
        space = self.category.shape_space
        exact = observation.pose_covariance is not None and not observation.pose_covariance.any()
        fit = latent_fit(space, cloud, refine_pose=self.refine_pose and not exact, viewpoint=viewpoint)
        pose = observation.camera_from_object @ fit.given_from_refined
        return ShapeEstimate(
            field=space.field(fit.latent),
            camera_from_object=pose,
            latent=fit.latent,
            covariance=_in_camera_axes(fit.joint_covariance, observation.camera_from_object),
            mask=observation.mask,
            status=_STATUS[fit.status],
            timings={"fit": time.perf_counter() - start},
        )


@dataclass(frozen=True)
class CpdEstimator:
    """Non-rigid CPD of the canonical cloud to the depth cloud, without category knowledge."""

    category: Category
    beta: float = 2.0
    lam: float = 2.0

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Register the canonical control points to the observed points."""
        start = time.perf_counter()
        cloud = depth_cloud(observation)
        result = cpd(self.category.shape_space.control_points, cloud, beta=self.beta, lam=self.lam)
        return ShapeEstimate(
            result.field,
            observation.camera_from_object,
            mask=observation.mask,
            status=_CPD_STATUS[result.status],
            timings={"cpd": time.perf_counter() - start},
        )


def _in_camera_axes(
    covariance: Float[np.ndarray, "s s"], camera_from_object: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "s s"]:
    """A joint covariance of turn, shift and latent, whose pose was along the told object's axes."""
    turned = np.eye(len(covariance))
    turned[:3, :3] = turned[3:6, 3:6] = camera_from_object[:3, :3]
    return turned @ covariance @ turned.T


def depth_cloud(observation: Observation) -> Float[np.ndarray, "m 3"]:
    """Measured points of the object, in the object frame of the given pose [m].

    Raises:
        ImageError: no depth, no mask to tell the object apart, or too few measured pixels.
    """
    if observation.depth is None:
        raise ImageError("this estimator needs a depth picture", key="depth", value=None)
    if observation.mask is None:
        lacks = "this estimator needs a mask of the object"
        if observation.box is not None:
            lacks += ": a box also holds depth of what lies around it"
        fix = "Give mask=, a picture or a segmenter"
        raise ImageError(lacks, key="mask", value=None, fix=fix)
    measured = (observation.depth > 0) & observation.mask
    v, u = np.nonzero(measured)
    if len(v) < FEWEST_POINTS:
        raise ImageError(
            f"needs at least {FEWEST_POINTS} measured pixels on the object", key="depth", value=len(v)
        )
    keep = np.linspace(0, len(v) - 1, min(len(v), MOST_POINTS)).astype(int)
    pixels = np.stack([u[keep], v[keep]], -1).astype(float)
    points = observation.camera.unproject(pixels, observation.depth[v[keep], u[keep]])
    return transform_points(invert(observation.camera_from_object), points)


def _uniform_scale(category: Category, scale: float) -> DeformationField:
    """The field that scales the canonical model about its origin."""
    space = category.shape_space
    if scale == 1.0:
        return DeformationField.identity(space.control_points, beta=space.beta)
    # A Gaussian field is only nearly linear; a wide kernel keeps the error far below a millimetre.
    points = np.asarray(category.canonical.vertices)
    points = points[np.linspace(0, len(points) - 1, min(len(points), 1500)).astype(int)]
    return DeformationField.fit(space.control_points, points, points * scale, beta=3.0, regularisation=1e-9)


def _extent(box) -> Float[np.ndarray, "2"]:
    return np.array([box[2] - box[0], box[3] - box[1]])
