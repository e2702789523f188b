"""Joint refinement of pose and latent by Gauss-Newton on what one or several pictures say.

Unknowns are, for each pose, a turn about the object's origin and a shift (camera frame), and one latent.
Their residuals are those of `picture_evidence`, summed over the pictures, and the priors. The paper fits the
latent alone to offsets alone (eq. 13); flow says more where the shape is seen, and tells pose from shape.

A picture whose camera stands at `camera_from_first` sees the first camera's pose through it. A turn and a
shift along the first camera's axes are, along its own, the same vectors rotated: with the rotation R of
`camera_from_first`, the picture's hessian H becomes J' H J, J = diag(R, R, 1).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.frames import moved
from grasptransfer.perception.earlier_pictures import ObjectPosterior, pose_scaled
from grasptransfer.perception.picture_evidence import PictureEvidence, Quadratic
from grasptransfer.perception.pose_prior import POSE_OVERCONFIDENCE, PosePrior
from grasptransfer.perception.several_pictures import PicturePlace
from grasptransfer.perception.standing import Standing

ITERATIONS = 24
CONVERGED = 5e-2  # of a standard deviation: far below what grasps notice
LONGEST_STEP = (0.2, 0.05, 2.0)  # rad, m, standard deviations: beyond, a linear model says nothing
# When the vertices on the outline are searched: once flow and offsets have brought it near, and then
# again; after that they stay, or the fit would jump between neighbouring vertices for ever.
OUTLINE_SEARCHES = (3, 6, 9)

Poses = tuple[Float[np.ndarray, "4 4"], ...]
Latent = Float[np.ndarray, "k"]


@dataclass(frozen=True)
class PoseAndShape:
    """Result: refined poses, latent and the joint posterior covariance of the first pose and the latent.

    Args:
        poses: (4, 4) `camera_from_object`, one where the camera moved about the object, else one a picture.
        covariance: (6 + k, 6 + k) over turn [rad] and shift [m] of the first pose, and latent; 0 for a pose
            that was kept.
        converged: whether the latent's last step was small; the pose's is, by then, some 0.2 degrees and mm.
    """

    poses: Poses
    latent: Latent
    covariance: Float[np.ndarray, "s s"]
    converged: bool

    @property
    def camera_from_object(self) -> Float[np.ndarray, "4 4"]:
        """(4, 4) in the first picture's camera [m]."""
        return self.poses[0]


def fit_pose_and_shape(
    pictures: Sequence[PictureEvidence],
    poses: Sequence[Float[np.ndarray, "4 4"]],
    priors: Sequence[PosePrior | None],
    *,
    places: Sequence[PicturePlace] = (PicturePlace(),),
    earlier: ObjectPosterior | None = None,
    standing: Standing | None = None,
    overconfidence: float = POSE_OVERCONFIDENCE,
) -> PoseAndShape:
    """Maximise the posterior of poses and latent.

    Args:
        pictures: what each picture says.
        poses: each `camera_from_object` to start from.
        priors: prior of each pose about the given one; None trusts the pose it starts from.
        places: for each picture, the pose that it goes with, and how much it counts.
        earlier: what earlier pictures have left known, of the first pose and the latent.
        standing: the plane on which the object stands, in the first picture's camera.
        overconfidence: how many times less the pictures say of the poses than their residuals do.
    """
    known = _Known(tuple(pictures), tuple(places), tuple(priors), earlier, standing, overconfidence)
    at, latent = tuple(poses), known.first_latent()
    size, count = len(latent), len(at)
    fitted = [prior is not None for prior in priors]
    fitted[0] |= earlier is not None and earlier.pose_known
    free = np.flatnonzero(np.concatenate([np.repeat(fitted, 6), np.ones(size, bool)]))
    longest = np.concatenate([np.tile(np.repeat(LONGEST_STEP[:2], 3), count), np.full(size, LONGEST_STEP[2])])
    covariance, converged = np.zeros((6 * count + size,) * 2), False
    searched = standing is not None or any(picture.outline is not None for picture in pictures)
    for iteration in range(ITERATIONS):
        if iteration in OUTLINE_SEARCHES:
            known.search(at, latent)
        hessian, gradient = known.quadratic(at, latent)
        covariance[np.ix_(free, free)] = np.linalg.inv(hessian[np.ix_(free, free)])
        step = np.zeros(len(longest))
        step[free] = -covariance[np.ix_(free, free)] @ gradient[free]
        step *= min(1.0, 1 / max(np.abs(step / longest).max(), 1e-9))
        at = tuple(moved(pose, step[6 * number : 6 * number + 6]) for number, pose in enumerate(at))
        latent = latent + step[6 * count :]
        converged = bool(np.abs(step[6 * count :]).max() < CONVERGED)
        if converged and (not searched or iteration > OUTLINE_SEARCHES[-1]):
            break
    chosen = _columns(0, count, size)
    covariance = _unweighted(covariance[np.ix_(chosen, chosen)], known.share_of_prior(0))
    return PoseAndShape(at, latent, pose_scaled(covariance, overconfidence), converged)


@dataclass(frozen=True)
class _Known:
    """All that is known of poses and latent: hessian and gradient over turns, shifts and latent."""

    pictures: tuple[PictureEvidence, ...]
    places: tuple[PicturePlace, ...]
    priors: tuple[PosePrior | None, ...]
    earlier: ObjectPosterior | None
    standing: Standing | None
    overconfidence: float

    def first_latent(self) -> Latent:
        """The latent to start from: that of earlier pictures, or the mean of what these say as a whole."""
        if self.earlier is not None:
            return self.earlier.latent
        precision = self._latent_precision()
        parts = [place.weight * said.deviation**-2 / precision * said.mean for said, place in self._said()]
        return np.sum(parts, axis=0) if parts else np.zeros(self._modes)

    def search(self, poses: Poses, latent: Latent) -> None:
        """Find the vertices that lie on the outlines now, and those on which the object stands."""
        for picture, place in zip(self.pictures, self.places, strict=True):
            picture.search_outline(place.camera_from_object(poses), latent)
        if self.standing is not None:
            self.standing.search(poses[0], latent)

    def quadratic(self, poses: Poses, latent: Latent) -> Quadratic:
        """Hessian and gradient of the negative log posterior."""
        size = 6 * len(poses) + len(latent)
        evidence, pull = np.zeros((size, size)), np.zeros(size)
        for picture, place in zip(self.pictures, self.places, strict=True):
            own = picture.quadratic(place.camera_from_object(poses), latent)
            columns = _columns(place.pose, len(poses), len(latent))
            hessian, gradient = _along_first(own, place)
            evidence[np.ix_(columns, columns)] += place.weight * hessian
            pull[columns] += place.weight * gradient
        hold, back = self._prior(poses, latent)
        return evidence + hold, pull + back

    def _prior(self, poses: Poses, latent: Latent) -> Quadratic:
        size = 6 * len(poses) + len(latent)
        hold, pull = np.zeros((size, size)), np.zeros(size)
        shape = slice(6 * len(poses), None)
        hold[shape, shape], pull[shape] = np.diag(self._latent_precision()), self._latent_pull(latent)
        for number, (prior, pose) in enumerate(zip(self.priors, poses, strict=True)):
            rows = slice(6 * number, 6 * number + 6)
            if prior is not None:
                # Latents weigh as before: the given pose holds the more, in place of evidence that says the
                # less.
                held, pulled = prior.quadratic(pose, surer=self.overconfidence)
                share = self.share_of_prior(number)
                hold[rows, rows], pull[rows] = share * held, share * pulled
        first = _columns(0, len(poses), len(latent))
        if self.earlier is not None:
            _add(hold, pull, first, self.earlier.quadratic(poses[0], latent, surer=self.overconfidence))
        if self.standing is not None:
            held, pulled = self.standing.quadratic(poses[0], latent)
            _add(hold, pull, first, (self.overconfidence * held, self.overconfidence * pulled))
        return hold, pull

    def share_of_prior(self, number: int) -> float:
        """How much the prior of a pose counts: as the picture does that alone has this pose.

        Else two copies of a picture, with a pose each, would know their distance better than one.
        """
        weights = [place.weight for place in self.places if place.pose == number]
        return weights[0] if len(weights) == 1 else 1.0

    def _latent_precision(self) -> Latent:
        """Of the pictures' own statements and the shape space, which each of the statements already holds."""
        parts = [place.weight * said.deviation**-2 for said, place in self._said()]
        return np.sum([*parts, np.full(self._modes, self._left_to_space)], axis=0)

    def _latent_pull(self, latent: Latent) -> Latent:
        parts = [place.weight * said.deviation**-2 * (latent - said.mean) for said, place in self._said()]
        return np.sum([*parts, self._left_to_space * latent], axis=0)

    @property
    def _left_to_space(self) -> float:
        """How often the shape space's own prior counts beside the statements; earlier pictures hold it."""
        return float(self.earlier is None) - sum(place.weight for _, place in self._said())

    @property
    def _modes(self) -> int:
        return self.pictures[0].model.n_modes

    def _said(self):
        pairs = zip(self.pictures, self.places, strict=True)
        return [(picture.latent, place) for picture, place in pairs if picture.latent is not None]


def _columns(number: int, count: int, size: int) -> Int[np.ndarray, "s"]:
    """Where turn and shift of one of `count` poses and the latent lie among all unknowns."""
    return np.concatenate([np.arange(6 * number, 6 * number + 6), np.arange(6 * count, 6 * count + size)])


def _unweighted(covariance: Float[np.ndarray, "s s"], weight: float) -> Float[np.ndarray, "s s"]:
    """Of a pose whose picture and prior counted with this weight: for the pose alone they count fully."""
    if weight == 1.0:
        return covariance
    pose, across, latent = covariance[:6, :6], covariance[:6, 6:], covariance[6:, 6:]
    found = covariance.copy()
    found[:6, :6] -= (1 - weight) * (pose - across @ np.linalg.solve(latent, across.T))
    return found


def _along_first(own: Quadratic, place: PicturePlace) -> Quadratic:
    """Over turn and shift along the axes of the camera of the picture's pose, instead of its own."""
    if place.camera_from_first is None:
        return own
    turned, rotation = np.eye(len(own[1])), place.camera_from_first[:3, :3]
    turned[:3, :3] = turned[3:6, 3:6] = rotation
    return turned.T @ own[0] @ turned, turned.T @ own[1]


def _add(hold, pull, columns, part: Quadratic):
    hold[np.ix_(columns, columns)] += part[0]
    pull[columns] += part[1]
