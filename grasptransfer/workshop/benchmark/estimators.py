"""The estimators that are compared, by name; `gt` is the bound that true offsets give."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grasptransfer.category import Category
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.errors import SettingsError
from grasptransfer.perception.baselines import ClsEstimator, CpdEstimator, RigidEstimator, SimilarityEstimator
from grasptransfer.perception.canonical_view import view_canonical
from grasptransfer.perception.estimate import Estimator, ShapeEstimate, with_certain_pose
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.rgbd import RgbdEstimator
from grasptransfer.perception.zoom import zoom_box, zoom_camera

from grasptransfer.workshop.benchmark.seen_instances import Instance  # isort: skip

NAMES = ("gt", "cls", "cpd", "rgb", "rigid", "similarity")
OFFERED = (*NAMES, "rgbd")
TRUE_OFFSET_NOISE = 1e-3  # m: what the shape space cannot express of a true offset
CPD_OFFSET_NOISE = 4e-3  # m: how far CPD's correspondences are off, `measured` in the category files


@dataclass(frozen=True)
class TrueOffsetsEstimator:
    """The paper's "GT": true offsets at the canonical's visible pixels, completed by the shape space."""

    instance: Instance

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """MAP of the latent under the true offsets of what this view shows."""
        category, space = self.instance.category, self.instance.category.shape_space
        pose = observation.camera_from_object
        box = projected_box(np.asarray(category.canonical.vertices), observation.camera, pose)
        camera = zoom_camera(observation.camera, zoom_box(box))
        points = view_canonical(category.canonical, camera, pose).cell_points
        offsets = self.instance.true_field.displacement(points)
        noise = TRUE_OFFSET_NOISE if self.instance.exact else CPD_OFFSET_NOISE
        posterior = space.map_estimate(points, offsets, noise)
        covariance = with_certain_pose(posterior.covariance)
        return ShapeEstimate(space.field(posterior.mean), pose, latent=posterior.mean, covariance=covariance)


@dataclass(frozen=True)
class TrueFieldEstimator:
    """The whole true field at the told pose: what a perfect estimator would give the grasps."""

    instance: Instance

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """The instance's true field."""
        return ShapeEstimate(self.instance.true_field, observation.camera_from_object)


@dataclass
class EstimatorSet:
    """Builds the estimators of one instance; network and renderer are shared by all instances of a category.

    Args:
        refine_pose: let `rgb`, `rgbd` and `cls` refine the pose.
        weights: file for `rgb`; None takes the shipped ones.
    """

    renderer: Renderer
    refine_pose: bool
    weights: Path | None = None
    _rgb: RgbEstimator | None = None

    def of(self, instance: Instance, names: tuple[str, ...]) -> dict[str, Estimator]:
        """The estimators called `names` for this instance."""
        return {name: self._make(name, instance) for name in names}

    def _make(self, name: str, instance: Instance) -> Estimator:
        category = instance.category
        if name == "gt":
            return TrueOffsetsEstimator(instance)
        if name == "rgb":
            return _without_depth(self._picture(category))
        if name == "rgbd":
            first = _without_depth(self._picture(category))
            return RgbdEstimator(category, first)
        if name == "cls":
            return ClsEstimator(category, refine_pose=self.refine_pose)
        if name == "cpd":
            return CpdEstimator(category)
        if name == "rigid":
            return RigidEstimator(category)
        if name == "similarity":
            return SimilarityEstimator(category)
        raise SettingsError("unknown estimator", key="estimators", value=name, choices=OFFERED)

    def _picture(self, category: Category) -> RgbEstimator:
        if self._rgb is None or self._rgb.category.name != category.name:
            self._rgb = RgbEstimator(
                category, renderer=self.renderer, weights=self.weights, refine_pose=self.refine_pose
            )
        return self._rgb


def _without_depth(estimator: Estimator) -> Estimator:
    """RGB must not see depth, nor the exact mask: a box is all a detector gives."""
    return lambda observation: estimator(replace(observation, depth=None, mask=None))
