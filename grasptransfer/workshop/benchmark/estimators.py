"""The estimators that are compared, by name; `gt` is the bound that true offsets give."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from grasptransfer.drawing.boxes import projected_box
from grasptransfer.perception.canonical_view import view_canonical
from grasptransfer.perception.estimate import Estimator, ShapeEstimate, with_certain_pose
from grasptransfer.perception.estimators import ESTIMATORS, EstimatorSettings, EstimatorSpec, check_estimators
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.zoom import zoom_box, zoom_camera

from grasptransfer.workshop.benchmark.seen_instances import Instance  # isort: skip

TRUE_OFFSET_NOISE = 1e-3  # m: error of true offsets in the shape space.
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
    """The whole true field at the given pose: what a perfect estimator would give the grasps."""

    instance: Instance

    def __call__(self, observation: Observation) -> ShapeEstimate:
        """The instance's true field."""
        return ShapeEstimate(self.instance.true_field, observation.camera_from_object)


def _true_offsets(instance: Instance, _: EstimatorSettings) -> Estimator:
    return TrueOffsetsEstimator(instance)


def _true_field(instance: Instance, _: EstimatorSettings) -> Estimator:
    return TrueFieldEstimator(instance)


# What shapes are compared with, and what grasps are; each benchmark calls its bound "gt".
OF_SHAPES = {"gt": EstimatorSpec(_true_offsets, "true offsets of what is seen", bound=True)} | ESTIMATORS
OF_GRASPS = {"gt": EstimatorSpec(_true_field, "the true field at the true pose", bound=True)} | ESTIMATORS
NOT_BY_DEFAULT = ("rgbd",)  # It repeats the work of rgb, so it is measured only where it is named.
DEFAULT = tuple(name for name in OF_SHAPES if name not in NOT_BY_DEFAULT)
METHODS = tuple(name for name in DEFAULT if not OF_SHAPES[name].bound)
OF_DEPTH = tuple(name for name, spec in ESTIMATORS.items() if spec.needs_depth)


def shown_to(name: str, together: Observation) -> Observation:
    """Of pictures seen together the first alone, for an estimator that takes no more."""
    several = name in ESTIMATORS and ESTIMATORS[name].several_pictures
    return together if several else replace(together, further=())


@dataclass
class EstimatorSet:
    """Makes estimators by name; all instances of a category share the estimators that do not know the truth.

    Args:
        refine_pose: let the estimators that can refine the pose do so.
        weights: weight file for `rgb`; None takes the shipped ones.
        registry: `OF_SHAPES` or `OF_GRASPS`.
    """

    refine_pose: bool
    weights: Path | None = None
    registry: dict[str, EstimatorSpec] = field(default_factory=lambda: OF_SHAPES)
    _made: dict[tuple[str, str], Estimator] = field(default_factory=dict)

    def of(self, instance: Instance, names: tuple[str, ...]) -> dict[str, Estimator]:
        """The estimators called `names` for this instance.

        Raises:
            SettingsError: an unknown name.
        """
        check_estimators(names, key="estimators", known=self.registry)
        return {name: self._of(name, instance) for name in names}

    def _of(self, name: str, instance: Instance) -> Estimator:
        settings = EstimatorSettings(self.refine_pose, weights=self.weights, masks_for_depth_alone=True)
        spec = self.registry[name]
        if spec.bound:
            return spec.make(instance, settings)
        key = (name, instance.category.name)
        if key not in self._made:
            self._made[key] = spec.make(instance.category, settings)
        return self._made[key]
