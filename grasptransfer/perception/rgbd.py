"""The RGB-D estimator: what the picture says of shape and pose, and the measured depth on top.

The estimate from RGB and its joint covariance over turn, shift and latent are the prior. Where a ray
through a pixel meets the model, X = R (Z + mean + basis x) + t, the surface should have been measured:

    r = n . (X - P),   n the model's normal, P the point measured at this pixel

A measured pixel shows either that surface, or something else: what lies behind glass or before the object,
at any depth. How likely it is the surface follows from how far r may be off, J S J' + sigma^2, where S is
what is still believed of pose and latent: depth against the picture's belief is let go, and the more is
known, the stricter the test. The share of pixels that show something else is estimated with it
(expectation maximisation; the M-step is a Gauss-Newton step on pose and latent). Missing depth says
nothing, and without any the answer is that from RGB.

Source: mixtures of surface and outliers as in Myronenko and Song, Point Set Registration: Coherent Point
Drift, 2010; point-to-plane distances as in Chen and Medioni, Object Modelling by Registration of Multiple
Range Images, 1992.
"""

import logging
import time
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from grasptransfer.category import Category
from grasptransfer.frames import drift, invert, moved
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.seen_surface import SeenSurface, ShapedModel, see_surface
from grasptransfer.perception.several_pictures import MOVED_CAMERA
from grasptransfer.registration import motion_along

logger = logging.getLogger(__name__)

# m: an active stereo camera at 0.6 m errs by 1 mm (`depth_sensor`), a shape space by 0.5 to 2 (`measured`
# in the categories' files). Were it estimated, depth of something else could pass for a coarse surface.
NOISE = 0.002
# Both errors go together over neighbouring pixels: the whole visible side counts as this many.
INDEPENDENT_POINTS = 60.0
ELSEWHERE = 0.5  # m: depth range over which anything else may lie
ROUNDS = 8
BELIEFS = 3  # updates of the outlier share in each round
SETTLED = 0.05  # RMS step, in standard deviations of the prior
FEWEST_POINTS = 20  # measured pixels; fewer say nothing


@dataclass(frozen=True)
class RgbdEstimator:
    """From RGB, depth where it is given, and an approximate pose to the shape.

    Args:
        rgb: gives the first estimate, with a latent and its joint covariance; a pose that this takes as
            told stays as told.
    """

    category: Category
    rgb: Estimator

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """Estimate from RGB, then correct latent and pose by the measured depth."""
        estimate = self.rgb(observation.without("depth"))
        if all(picture.depth is None for picture, _ in _with_relations(observation)):
            logger.warning("Estimator 'rgbd' was given no depth: the picture alone answers.")
            return estimate
        if estimate.latent is None or estimate.covariance is None:
            return estimate
        start = time.perf_counter()
        fused = self._fuse(estimate, observation)
        return replace(fused, timings=fused.timings | {"depth": time.perf_counter() - start})

    @cached_property
    def _model(self) -> ShapedModel:
        return ShapedModel(self.category)

    def _fuse(self, estimate: ShapeEstimate, observation: Observation) -> ShapeEstimate:
        fit = _Fit(estimate)
        pictures = [
            (picture, _on_object(picture, estimate.mask if picture is observation else None), relation)
            for picture, relation in _with_relations(observation)
            if picture.depth is not None
        ]
        for _ in range(ROUNDS):
            seen = [self._measure(fit, *picture) for picture in pictures]
            if sum(len(one.gap) for one in seen) < FEWEST_POINTS:
                return estimate
            if fit.step(_Measured.together(seen)) < SETTLED:
                break
        return replace(
            estimate,
            field=self.category.shape_space.field(fit.latent),
            camera_from_object=fit.pose,
            latent=fit.latent,
            covariance=fit.joint_covariance,
        )

    def _measure(
        self,
        fit: "_Fit",
        picture: Observation,
        depth: Float[np.ndarray, "h w"],
        camera_from_first: Float[np.ndarray, "4 4"],
    ) -> "_Measured":
        """What is measured where a picture shows the model as fitted so far."""
        pose = camera_from_first @ fit.pose
        seen = see_surface(self._model, fit.latent, picture.camera, pose)
        measured = seen.where(seen.sampled(depth) > 0)
        rays = picture.camera.unproject(measured.pixels.astype(float), np.ones(len(measured.pixels)))
        facing = -(measured.normals_object @ pose[:3, :3].T * rays).sum(1)
        share = np.full(len(rays), min(1.0, INDEPENDENT_POINTS / max(len(seen.pixels), 1)))
        return _Measured(measured, facing, measured.sampled(depth) - measured.depth(pose), share)


@dataclass(frozen=True)
class _Measured:
    """Points of the model whose depth was measured.

    Args:
        seen: the points.
        facing: how far the surface goes along its normal with 1 m of depth.
        gap: how far behind the model's surface depth was measured [m].
        share: how many independent points each counts for.
    """

    seen: SeenSurface
    facing: Float[np.ndarray, "p"]
    gap: Float[np.ndarray, "p"]
    share: Float[np.ndarray, "p"]

    @staticmethod
    def together(parts: "list[_Measured]") -> "_Measured":
        """Those of several pictures."""
        seen = SeenSurface(
            *(
                np.concatenate([getattr(part.seen, field.name) for part in parts])
                for field in fields(SeenSurface)
            )
        )
        facing, gap, share = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("facing", "gap", "share")
        )
        return _Measured(seen, facing, gap, share)


class _Fit:
    """Pose and latent, what is believed of them, and the steps that fit them to depth."""

    def __init__(self, estimate: ShapeEstimate):
        assert estimate.latent is not None
        assert estimate.covariance is not None
        self._told, self._started = estimate.camera_from_object, estimate.latent
        self.pose, self.latent = self._told, self._started
        self._free = np.flatnonzero(np.diag(estimate.covariance) > 0)
        self._covariance = estimate.covariance[np.ix_(self._free, self._free)]
        self._precision = np.linalg.inv(self._covariance)
        self._astray = 0.5

    @property
    def joint_covariance(self) -> Float[np.ndarray, "s s"]:
        """Over turn, shift and latent; 0 where the pose was taken as told."""
        joint = np.zeros((6 + len(self.latent),) * 2)
        joint[np.ix_(self._free, self._free)] = self._covariance
        return joint

    def step(self, measured: _Measured) -> float:
        """One round; returns the step's length in the prior's standard deviations."""
        seen, facing, gap, share = measured.seen, measured.facing, measured.gap, measured.share
        turned, normals = seen.points_object @ self.pose[:3, :3].T, seen.normals_object @ self.pose[:3, :3].T
        jacobian = motion_along(normals, turned, seen.by_latent, self.pose[:3, :3])[:, self._free]
        residual = facing * gap
        weight = share * self._own_surface(jacobian, facing, gap, share)
        drift = self._drift()[self._free]
        rows = jacobian * (weight / NOISE**2)[:, None]
        self._covariance = np.linalg.inv(rows.T @ jacobian + self._precision)
        step = -self._covariance @ (rows.T @ residual + self._precision @ drift)
        self._move(step)
        return float(np.sqrt(step @ self._precision @ step / len(step)))

    def _own_surface(self, jacobian, facing, gap, share) -> Float[np.ndarray, "p"]:
        """How likely each measured depth is that of the model's surface; estimates the others' share."""
        deviation = np.sqrt(NOISE**2 + self._uncertainty(jacobian)) / np.maximum(facing, 1e-3)
        density = np.exp(-0.5 * np.square(gap / deviation)) / (np.sqrt(2 * np.pi) * deviation)
        own = np.zeros(len(gap))
        for _ in range(BELIEFS):
            surface, other = (1 - self._astray) * density, self._astray / ELSEWHERE
            own = surface / (surface + other)
            self._astray = (1 + (share * (1 - own)).sum()) / (2 + share.sum())  # all shares alike before
        return own

    def _uncertainty(self, jacobian) -> Float[np.ndarray, "p"]:
        """Variance of the residuals from what is not known of pose and latent [m^2]."""
        return np.einsum("pi,ij,pj->p", jacobian, self._covariance, jacobian)

    def _drift(self) -> Float[np.ndarray, "s"]:
        """How far pose and latent have gone from the prior's."""
        return np.concatenate([drift(self._told, self.pose), self.latent - self._started])

    def _move(self, free_step: Float[np.ndarray, "f"]):
        step = np.zeros(6 + len(self.latent))
        step[self._free] = free_step
        self.pose = moved(self.pose, step[:6])
        self.latent = self.latent + step[6:]


def _with_relations(observation: Observation) -> list[tuple[Observation, Float[np.ndarray, "4 4"]]]:
    """The pictures whose depth counts, each with its camera from the first one's.

    Poses that err each by itself do not say how the cameras stand: then the first picture's depth alone
        counts.
    """
    first = invert(observation.camera_from_object)
    pictures = observation.pictures if observation.views == MOVED_CAMERA else (observation,)
    return [(one, np.eye(4) if one is observation else one.camera_from_object @ first) for one in pictures]


def _on_object(observation: Observation, predicted: np.ndarray | None) -> Float[np.ndarray, "h w"]:
    """Depth on the object: within the told mask, or else the predicted one [m]."""
    assert observation.depth is not None
    mask = predicted if observation.mask is None else observation.mask
    depth = np.asarray(observation.depth, float)
    return depth if mask is None else np.where(mask, depth, 0.0)
