"""From what was given with the pictures to what the fit starts from: poses, priors, places and weights."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from grasptransfer.drawing.boxes import Box, projected_box
from grasptransfer.frames import invert, moved
from grasptransfer.perception.earlier_pictures import ObjectPosterior, with_latent_covariance
from grasptransfer.perception.observation import Observation
from grasptransfer.perception.pose_and_shape import PoseAndShape
from grasptransfer.perception.pose_prior import PoseDeviation, PosePrior, pose_overconfidence
from grasptransfer.perception.several_pictures import (
    MOVED_CAMERA,
    PicturePlace,
    seen_from,
    share_of_new,
    weights_of,
)
from grasptransfer.perception.zoom import centre_on_box

# Of the given box's side: a pose that misses its centre by more is centred on it first. Boxes are of what
# is seen of the object, and so wrong by some hundredths of their sides even where nothing hides it.
ROUGH, BOX_SIGMA = 0.2, 0.05
SHIFT_SIGMA = 0.05  # m: how far such a pose may be off along each axis
ROUNDS = 3  # of the search for the shift that centres the object on all boxes

Pose = Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Arrangement:
    """What the fit starts from.

    Args:
        start: `camera_from_object` to start from: one where the camera moved, else one a picture.
        priors: prior of each pose; None for one that is exact, or known from earlier pictures.
        places: place of each picture.
        sigma: how sure the first pose is before the pictures; None where it is exact.
        earlier: what earlier pictures have left known.
        new: share of what these pictures say that earlier ones have not said yet.
        seen_from: (a, 3) directions of all pictures so far, object axes.
        overconfidence: how many times less the pictures say of the poses than their residuals do.
    """

    start: tuple[Pose, ...]
    priors: tuple[PosePrior | None, ...]
    places: tuple[PicturePlace, ...]
    sigma: PoseDeviation | None
    earlier: ObjectPosterior | None
    new: float
    seen_from: Float[np.ndarray, "a 3"]
    overconfidence: float

    def latent(self, modes: int) -> Float[np.ndarray, "k"]:
        """The latent of the model with which the pictures are compared first."""
        return np.zeros(modes) if self.earlier is None else self.earlier.latent

    def posterior(self, fit: PoseAndShape, given: Pose) -> ObjectPosterior:
        """What the pictures so far leave known.

        Pictures that repeat what earlier ones have said should count by their share of new alone. Their poses
        are still found by all that they show: so they counted fully in the fit, and what was known of the
        latent counted the more (`arrange`). Its covariance is that much too narrow.

        Args:
            fit: the fit that started from here.
            given: (4, 4) the given pose in the first picture [m].
        """
        covariance = fit.covariance
        if self.earlier is not None:
            covariance = with_latent_covariance(covariance, covariance[6:, 6:] / self.new)
        return ObjectPosterior(fit.camera_from_object, fit.latent, covariance, self.seen_from, given)


def arrange(observation: Observation, vertices: Float[np.ndarray, "v 3"], *, refine: bool) -> Arrangement:
    """Poses to start from, their priors, and the weights of the pictures.

    Args:
        vertices: vertices of the canonical model [m].
        refine: whether poses are refined at all.
    """
    pictures, earlier = observation.pictures, observation.earlier
    given = [picture.camera_from_object for picture in pictures]
    directions = seen_from(np.stack(given))
    weights = [float(weight) for weight in weights_of(directions)]
    moved_camera = observation.views == MOVED_CAMERA
    if moved_camera:
        relations = [None, *(pose @ invert(given[0]) for pose in given[1:])]
        places = tuple(PicturePlace(0, *one) for one in zip(relations, weights, strict=True))
    else:
        places = tuple(PicturePlace(number, None, weight) for number, weight in enumerate(weights))
    own = pictures[:1] if moved_camera else pictures
    priors = tuple(
        PosePrior.of(one.camera_from_object, one.pose_covariance) if refine else None for one in own
    )
    sigma = None if priors[0] is None else priors[0].deviation
    start = tuple(given[: len(own)])
    if moved_camera and len(pictures) > 1 and priors[0] is not None:
        start = (_centred_on_all(pictures, places, vertices),)
    else:
        pairs = zip(own, priors, strict=True)
        start = tuple(
            one.camera_from_object if prior is None else _centred(one, vertices) for one, prior in pairs
        )
    if earlier is None:
        seen = sum(weights) if moved_camera else 1.0  # a pose that errs by itself is seen once
        return Arrangement(start, priors, places, sigma, None, 1.0, directions, pose_overconfidence(seen))
    new, together = (
        share_of_new(earlier.seen_from, directions),
        np.concatenate([earlier.seen_from, directions]),
    )
    narrowed = with_latent_covariance(earlier.covariance, new * earlier.covariance[6:, 6:])
    known = earlier.pose_known and priors[0] is not None
    earlier = replace(earlier, covariance=narrowed, pose_known=known)
    if known:
        start = (earlier.camera_from_object, *start[1:])
        priors = (None, *priors[1:])
        sigma = PoseDeviation.of(earlier.camera_from_object, earlier.covariance[:6, :6])
    seen = float(weights_of(together).sum()) if known else 1.0
    return Arrangement(start, priors, places, sigma, earlier, new, together, pose_overconfidence(seen))


def _centred(picture: Observation, vertices: Float[np.ndarray, "v 3"]) -> Pose:
    """The given pose; one that lies far from the given box is first centred on it, as in training."""
    pose, box = picture.camera_from_object, picture.box
    if box is None or not _is_rough(picture, pose, vertices):
        return pose
    return centre_on_box(vertices, picture.camera, pose, box)


def _is_rough(picture: Observation, pose: Pose, vertices: Float[np.ndarray, "v 3"]) -> bool:
    if picture.box is None:
        return False
    return bool(np.hypot(*_aside(picture, pose, vertices)) >= ROUGH * _side(picture.box))


def _aside(picture: Observation, pose: Pose, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "2"]:
    """From the centre of the model's box to that of the given one [px]."""
    assert picture.box is not None
    u0, v0, u1, v1 = projected_box(vertices, picture.camera, pose)
    box = picture.box
    return np.array([box[0] + box[2] - u0 - u1, box[1] + box[3] - v0 - v1]) / 2


def _side(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


def _centred_on_all(
    pictures: tuple[Observation, ...], places: tuple[PicturePlace, ...], vertices: Float[np.ndarray, "v 3"]
) -> Pose:
    """The given pose of the first picture; a rough one is first shifted to where the boxes' centres meet."""
    start = pictures[0].camera_from_object
    pose = start
    seen = [
        (picture, place) for picture, place in zip(pictures, places, strict=True) if picture.box is not None
    ]
    if not any(_is_rough(picture, place.camera_from_object((pose,)), vertices) for picture, place in seen):
        return pose
    for _ in range(ROUNDS):
        hessian = np.eye(3) / SHIFT_SIGMA**2
        pull = (start[:3, 3] - pose[:3, 3]) / SHIFT_SIGMA**2
        for picture, place in seen:
            assert picture.box is not None
            own = place.camera_from_object((pose,))
            slope = _centre_by_shift(picture, own) @ own[:3, :3] @ pose[:3, :3].T
            precision = (BOX_SIGMA * _side(picture.box)) ** -2
            hessian += precision * slope.T @ slope
            pull += precision * slope.T @ _aside(picture, own, vertices)
        pose = moved(pose, np.concatenate([np.zeros(3), np.linalg.solve(hessian, pull)]))
    return pose


def _centre_by_shift(picture: Observation, pose: Pose) -> Float[np.ndarray, "2 3"]:
    """How the object's centre moves in the picture with a shift along the camera's axes [px/m]."""
    camera, (x, y, z) = picture.camera, pose[:3, 3]
    return np.array(
        [[camera.fx / z, 0.0, -camera.fx * x / z**2], [0.0, camera.fy / z, -camera.fy * y / z**2]]
    )
