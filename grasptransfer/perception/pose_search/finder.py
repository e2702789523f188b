"""The search for the pose of an object from picture and box alone.

A box and the intrinsics give the distance and bearing of the mean model for every view. One network of the
ensemble compares the picture with the model from each view of a grid; the likeliest views are fitted as given
poses are, with a wide prior; one more pass scores each fit, and those that show the same surfaces are one.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from grasptransfer import given
from grasptransfer.category import Category, load_category
from grasptransfer.drawing.boxes import Box
from grasptransfer.errors import ImageError, PoseError
from grasptransfer.frames import check_rigid, rigid, rotation_angle, transform_points
from grasptransfer.perception.estimate import Estimator, ShapeEstimate
from grasptransfer.perception.observation import observe
from grasptransfer.perception.pose_prior import PoseDeviation
from grasptransfer.perception.pose_search.chances import FittedChances
from grasptransfer.perception.pose_search.grid import misfit, pose_in_box, poses_on_table, view_rotations
from grasptransfer.perception.pose_search.one_member import OneMember
from grasptransfer.perception.pose_search.traits import SeenBox, pose_traits, view_traits
from grasptransfer.perception.rgb import RgbEstimator
from grasptransfer.perception.standing import Support

SLENDER = 0.6  # views whose box differs more from the given one, as a logarithm of side ratios, are left out
FEWEST_VIEWS = 24
APART = np.deg2rad(28)  # views nearer than this to a likelier one are fitted with it
MOST_FITTED, LEAST_CHANCE = 6, 0.01
# The prior of a fit that begins at a view: half a step of the grid, the size of instances, a detector's box.
START_TURN, START_ALONG, START_ACROSS = np.deg2rad(15), 0.15, 0.03
SAME = 0.04  # of the model's size: fits whose surfaces lie nearer are one
CONTACT_SIGMA = 0.003  # m: paper that is not quite flat, and a board that is found to a millimetre or two
FEWEST_SHOWN = 0.01  # proposals less likely are not worth a person's look


@dataclass(frozen=True)
class FoundPose:
    """A proposed pose.

    Args:
        camera_from_object: (4, 4) [m].
        chance: that it is right within some 15 degrees; those of all proposals sum to less than 1.
        pose_sigma: (6, 6) covariance of its error, if it is right: turn [rad], then shift [m], camera axes.
        box: (u0, v0, u1, v1) around the object [px], as given.
        estimate: shape and pose, as fitted from the view.
    """

    camera_from_object: Float[np.ndarray, "4 4"]
    chance: float
    pose_sigma: Float[np.ndarray, "6 6"]
    box: Box
    estimate: ShapeEstimate

    @property
    def deviation(self) -> PoseDeviation:
        """Its standard deviations along the ray, across it, and of the turn."""
        return PoseDeviation.of(self.camera_from_object, self.pose_sigma)


@dataclass(frozen=True)
class Fitted:
    """A pose fitted from a view, and what speaks for it: a row of `POSE_TRAITS`."""

    estimate: ShapeEstimate
    traits: Float[np.ndarray, "t"]


@dataclass(frozen=True)
class ScoredViews:
    """Views of the grid with the poses that fill the box, and what speaks for each: `VIEW_TRAITS`."""

    poses: Float[np.ndarray, "c 4 4"]
    traits: Float[np.ndarray, "c t"]


class PoseFinder:
    """Finds poses of instances of one category; networks are loaded at the first picture and stay warm.

    Args:
        category: name, folder or loaded `Category`; it needs trained networks.
        estimator: any of the category's; one that has its networks loaded lends them.
        device: of the fits, as of `GraspTransfer`.

    Raises:
        CategoryError: unknown category.
    """

    def __init__(
        self,
        category: str | Path | Category,
        *,
        estimator: Estimator | None = None,
        device: str = "auto",
    ):
        self.category = load_category(category)
        self._lent, self._device = estimator, device
        self._points = np.asarray(self.category.canonical.vertices)

    @cached_property
    def estimator(self) -> RgbEstimator:
        """Fits pose and shape."""
        if isinstance(self._lent, RgbEstimator):
            return self._lent
        return RgbEstimator(self.category, device=self._device)

    @cached_property
    def _network(self) -> OneMember:
        return OneMember(self.category)

    def find(
        self,
        image: given.Pictures,
        *,
        camera: given.Cameras = None,
        box: given.Boxes = None,
        mask: given.Masks = None,
        camera_from_table: given.Matrix = None,
        support: Support | None = None,
    ) -> tuple[FoundPose, ...]:
        """Proposals, the likeliest first; arguments as of `find_pose`, or a mask as of `transfer_grasps`.

        Args:
            support: in place of `camera_from_table`, the plane of a scene on which the object stands.

        Raises:
            GraspTransferError: as of `find_pose`.
        """
        seen = self.see(image, camera=camera, box=box, mask=mask)
        if support is not None:
            turn = Rotation.align_vectors([support.normal], [[0.0, 0.0, 1.0]])[0].as_matrix()
            camera_from_table = rigid(turn, support.point)
        return self.find_in(seen, camera_from_table=camera_from_table)

    def find_in(self, seen: SeenBox, *, camera_from_table: given.Matrix = None) -> tuple[FoundPose, ...]:
        """Proposals for a box in a picture; `camera_from_table` as of `find_pose`."""
        starts = None
        if camera_from_table is not None:
            table = check_rigid(camera_from_table, "camera_from_table")
            support = Support(table[:3, 3], table[:3, 2], CONTACT_SIGMA)
            seen = replace(seen, observation=replace(seen.observation, support=support))
            starts = poses_on_table(self._points, seen.observation.camera, table, seen.box)
        chances = FittedChances.read()
        fits = self.fit(seen, self.score(seen, starts), chances)
        if not fits:
            raise PoseError("no view of the model fits the picture in this box", key="box", value=seen.box)
        shares = chances.poses.chances(np.stack([fit.traits for fit in fits]))
        order = [index for index in np.argsort(-shares) if shares[index] >= FEWEST_SHOWN or index == 0]
        return tuple(self._found(fits[index], float(shares[index]), seen) for index in order)

    def see(
        self,
        image: given.Pictures,
        *,
        camera: given.Cameras = None,
        box: given.Boxes = None,
        mask: given.Masks = None,
    ) -> SeenBox:
        """The picture, checked, and the object's box in it, which a mask gives, too.

        Raises:
            ImageError: neither is given, or the picture is wrong.
        """
        somewhere = np.eye(4)
        somewhere[2, 3] = 1.0  # a picture is checked with a pose; which one does not matter here
        observation = observe(image, somewhere, camera=camera, box=box, mask=mask)
        if observation.box is None:
            fix = "Give u0, v0, u1, v1 of the object in pixels, as any detector does, or a mask"
            raise ImageError("is needed to find a pose", key="box", fix=fix)
        return SeenBox(observation, observation.box)

    def score(self, seen: SeenBox, poses: Float[np.ndarray, "c 4 4"] | None = None) -> ScoredViews:
        """Compare the picture with the model at each pose; None: all views of the grid, filling the box.

        Of the grid, views whose box is of quite another slenderness are left out.
        """
        if poses is None:
            camera = seen.observation.camera
            poses = np.stack(
                [pose_in_box(self._points, camera, rotation, seen.box) for rotation in view_rotations()]
            )
            apart = np.array([misfit(self._points, camera, pose, seen.box) for pose in poses])
            limit = max(SLENDER, float(np.sort(apart)[FEWEST_VIEWS - 1]))
            poses = poses[apart <= limit]
        return ScoredViews(poses, view_traits(self._network, self.category, seen, poses))

    def fit(self, seen: SeenBox, views: ScoredViews, chances: FittedChances) -> list[Fitted]:
        """Fit pose and shape from each of the likeliest views; equal fits are one."""
        shares = chances.views.chances(views.traits)
        fits: list[Fitted] = []
        for index in _spread(views.poses, shares):
            start = views.poses[index]
            covariance = START_TURN**2 * np.eye(6)
            covariance[3:, 3:] = _shift_covariance(start, START_ALONG, START_ACROSS)
            given = replace(seen.observation, camera_from_object=start, pose_covariance=covariance)
            try:
                estimate, _ = self.estimator.assess(given)
                traits = pose_traits(self.estimator, seen, estimate, float(np.log(shares[index] + 1e-6)))
            except PoseError:
                continue  # the fit has lost the object from this view
            fits.append(Fitted(estimate, traits))
        return self._merged(fits, chances)

    def _merged(self, fits: list[Fitted], chances: FittedChances) -> list[Fitted]:
        """Of fits that show the same surfaces, as of a round bottle turned about its axis, the likeliest."""
        kept: list[tuple[Fitted, Float[np.ndarray, "v 3"]]] = []
        limit = SAME * float(self.category.canonical.extents.max())
        for fit in sorted(fits, key=lambda fit: -float(fit.traits @ chances.poses.by_trait)):
            surface = self._surface(fit.estimate)
            if all(_apart(surface, other) > limit for _, other in kept):
                kept.append((fit, surface))
        return [fit for fit, _ in kept]

    def _surface(self, estimate: ShapeEstimate) -> Float[np.ndarray, "v 3"]:
        """Points of the reconstruction, camera frame, scaled with their distance to the model's size.

        Fits that differ in size and distance alike are one in the picture, and so they are here.
        """
        assert estimate.latent is not None
        vertices = self.category.vertices_by_latent.displaced(self._points, estimate.latent)
        placed = transform_points(estimate.camera_from_object, vertices)
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        canonical = float(np.linalg.norm(np.ptp(self._points, axis=0)))
        return (placed * canonical / size)[:: max(1, len(placed) // 1500)]

    def _found(self, fit: Fitted, chance: float, seen: SeenBox) -> FoundPose:
        pose, covariance = fit.estimate.camera_from_object, fit.estimate.covariance
        sigma = uncertainty_of(pose)
        if seen.observation.support is not None and covariance is not None:
            sigma = covariance[:6, :6]  # on a table, distance no longer hangs on the size
        return FoundPose(pose, chance, sigma, seen.box, fit.estimate)


def uncertainty_of(camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of the error of a right pose whose distance follows from the object's size alone."""
    chances = FittedChances.read()
    covariance = np.deg2rad(chances.turn) ** 2 * np.eye(6)
    covariance[3:, 3:] = _shift_covariance(camera_from_object, chances.along_ray, chances.across_ray)
    return covariance


def find_pose(
    image: given.Picture,
    category: str | Path | Category,
    *,
    camera: given.Cameras = None,
    box: given.Boxes = None,
    camera_from_table: given.Matrix = None,
) -> tuple[FoundPose, ...]:
    """Propose poses of an instance from one RGB picture, the likeliest first.

    The object is taken to stand upright before a camera that is held about level, and to have about the size
    that the category's shapes have: size and distance cannot be told apart in one picture. Where the picture
    leaves several poses open, each comes with its chance; for many pictures keep a `PoseFinder`.

    Args:
        image: path, PIL picture or uint8 (h, w, 3) RGB.
        category: name, folder or loaded `Category`.
        camera: as of `transfer_grasps`.
        box: (u0, v0, u1, v1) around the object [px], as any detector gives it; the networks do not find it.
        camera_from_table: (4, 4) a table on which the object stands, z up from it [m], or None. It decides
            distance and tilt, so that only the heading is searched.

    Raises:
        GraspTransferError: wrong input, or nothing that looks like the category was found.
    """
    return PoseFinder(category).find(image, camera=camera, box=box, camera_from_table=camera_from_table)


def _spread(poses: Float[np.ndarray, "c 4 4"], shares: Float[np.ndarray, "c"]) -> list[int]:
    """The likeliest views, each far from those before it."""
    chosen: list[int] = []
    for index in np.argsort(-shares):
        near = [rotation_angle(poses[index][:3, :3] @ poses[other][:3, :3].T) < APART for other in chosen]
        if not any(near):
            chosen.append(int(index))
        if len(chosen) == MOST_FITTED:
            break
    return [index for index in chosen if shares[index] > LEAST_CHANCE * shares[chosen[0]]]


def _apart(a: Float[np.ndarray, "v 3"], b: Float[np.ndarray, "v 3"]) -> float:
    """Mean distance between two clouds, both ways [m]."""
    return float((KDTree(a).query(b)[0].mean() + KDTree(b).query(a)[0].mean()) / 2)


def _shift_covariance(
    camera_from_object: Float[np.ndarray, "4 4"], along: float, across: float
) -> Float[np.ndarray, "3 3"]:
    """Of a shift whose deviations are these shares of the distance along the ray and across it."""
    distance = float(np.linalg.norm(camera_from_object[:3, 3]))
    ray = camera_from_object[:3, 3] / distance
    projector = np.outer(ray, ray)
    return distance**2 * (along**2 * projector + across**2 * (np.eye(3) - projector))
