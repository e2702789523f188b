"""Residuals of a shape space and a pose against a cloud, with analytic derivatives.

The state is (turn [rad], shift [m], latent), or the latent alone where the pose is kept:
p = exp(turn) R0 (Z + mean + basis x) + t0 + shift.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from grasptransfer.registration.displacement_model import DisplacementModel, motion_along

NEIGHBOURS = 10  # that span a point's tangent plane
COVERAGE = 0.3  # weight of a visible model point without observed counterpart, against an observed point


@dataclass(frozen=True)
class GaussianPosePrior:
    """How far the given pose may be wrong: standard deviations.

    Args:
        rotation: about each axis [rad].
        translation: along each axis [m].
    """

    rotation: float = 0.1
    translation: float = 0.02

    @classmethod
    def of_scale(cls, scale: float) -> "GaussianPosePrior":
        """A quarter of the object's RMS radius [m] and six degrees."""
        return cls(translation=0.25 * scale)


@dataclass(frozen=True, eq=False)
class Posed:
    """Model points as a function of the state.

    Args:
        points_canonical: (p, 3) model points [m].
        model: their displacement by the latent.
        initial: (4, 4) pose that the state corrects.
        prior: prior of the correction; None keeps the pose.
    """

    points_canonical: Float[np.ndarray, "p 3"]
    model: DisplacementModel
    initial: Float[np.ndarray, "4 4"]
    prior: GaussianPosePrior | None

    @property
    def n_modes(self) -> int:
        """k."""
        return self.model.n_modes

    @cached_property
    def root_precision(self) -> Float[np.ndarray, "s"]:
        """Reciprocal standard deviations of the state's prior."""
        pose = [] if self.prior is None else [1 / self.prior.rotation] * 3 + [1 / self.prior.translation] * 3
        return np.concatenate([pose, np.ones(self.n_modes)])

    def start(self) -> Float[np.ndarray, "s"]:
        """The state of the mean shape at the initial pose."""
        return np.zeros(len(self.root_precision))

    def pose(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "4 4"]:
        """`given_from_refined`."""
        pose = self.initial.copy()
        if self.prior is not None:
            pose[:3, :3] = Rotation.from_rotvec(state[:3]).as_matrix() @ pose[:3, :3]
            pose[:3, 3] += state[3:6]
        return pose

    def points(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "p 3"]:
        """Model points, given object frame [m]."""
        pose = self.pose(state)
        return self._shape(state) @ pose[:3, :3].T + pose[:3, 3]

    def jacobian(
        self, state: Float[np.ndarray, "s"], chosen: Any = slice(None)
    ) -> Float[np.ndarray, "q 3 s"]:
        """Derivative of the chosen points by the state."""
        pose = self.pose(state)
        by_latent = pose[:3, :3] @ self.model.basis[chosen]
        if self.prior is None:
            return by_latent
        turned = self._shape(state, chosen) @ pose[:3, :3].T
        # -[p]x of each point, times the left Jacobian, row by row: p x (its columns)
        by_turn = -np.cross(turned[:, None], _left_jacobian(state[:3]).T).transpose(0, 2, 1)
        return np.concatenate([by_turn, np.broadcast_to(np.eye(3), by_turn.shape), by_latent], axis=2)

    def along(
        self, state: Float[np.ndarray, "s"], chosen: Any, directions: Float[np.ndarray, "q 3"]
    ) -> Float[np.ndarray, "q s"]:
        """Derivative by the state of how far the chosen points are in given directions."""
        rotation = self.pose(state)[:3, :3]
        turned = self._shape(state, chosen) @ rotation.T
        rows = motion_along(directions, turned, self.model.basis[chosen], rotation)
        if self.prior is None:
            return rows[:, 6:]
        rows[:, :3] = rows[:, :3] @ _left_jacobian(state[:3])
        return rows

    def step(
        self,
        state: Float[np.ndarray, "s"],
        chosen: Bool[np.ndarray, "p"],
        weights: Float[np.ndarray, "q"],
        pull: Float[np.ndarray, "q 3"],
    ) -> Float[np.ndarray, "s"]:
        """The Gauss-Newton step that moves the chosen points by `pull`, under the prior."""
        jacobian = self.jacobian(state, chosen)
        size = len(state)
        rows = (jacobian * weights[:, None, None]).reshape(-1, size)
        precision = np.square(self.root_precision)
        normal = rows.T @ jacobian.reshape(-1, size) + np.diag(precision)
        return np.linalg.solve(normal, rows.T @ pull.ravel() - precision * state)

    def joint(
        self, covariance: Float[np.ndarray, "s s"], state: Float[np.ndarray, "s"]
    ) -> Float[np.ndarray, "j j"]:
        """Covariance at a state, over turn from there, shift and latent; 0 for a pose that is kept."""
        joint = np.zeros((6 + self.n_modes,) * 2)
        joint[-len(state) :, -len(state) :] = covariance
        if self.prior is not None:
            onward = np.eye(len(joint))
            onward[:3, :3] = _left_jacobian(state[:3])
            joint = onward @ joint @ onward.T
        return joint

    def _shape(self, state, chosen: Any = slice(None)) -> Float[np.ndarray, "q 3"]:
        latent = state[len(state) - self.n_modes :]
        return self.model.take(chosen).displaced(self.points_canonical[chosen], latent)


class FitResiduals:
    """What `scipy.optimize.least_squares` minimises.

    Args:
        observed: (m, 3) observed points [m].
        noise: standard deviation of the matches [m].
        robust_scale: residuals beyond this many of them count less and less (Cauchy).
        visible: (p,) model points that should have an observed counterpart; None asks it of none.
        sliding: how freely a match may slide along the surface: 0 holds it, 1 lets it go.
    """

    def __init__(
        self, posed: Posed, observed, noise: float, robust_scale: float, visible=None, sliding: float = 0.0
    ):
        from scipy.spatial import KDTree

        self._hold, self._normals = 1 - sliding, surface_normals(observed) if sliding else None

        self.posed, self.observed = posed, observed
        self.noise, self.robust_scale = noise, robust_scale
        self.visible = np.zeros(0, int) if visible is None else np.flatnonzero(visible)
        self._observed_tree = KDTree(observed)
        # All visible points together count like this share of the observed ones.
        self._coverage = np.sqrt(COVERAGE * len(observed) / max(len(self.visible), 1))
        self._tree = KDTree
        self._last: tuple[bytes, tuple] = b"", ()

    def values(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "r"]:
        """Robust lengths of the matches, then the prior's residuals."""
        differences, _, weights = self._matches(state)
        lengths, _ = self._robust(np.linalg.norm(self._slide(differences), axis=1) / self.noise)
        return np.concatenate([weights * lengths, self.posed.root_precision * state])

    def jacobian(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "r s"]:
        """Derivative of `values`; the matches are held."""
        differences, chosen, weights = self._matches(state)
        differences = self._slide(differences)
        lengths = np.linalg.norm(differences, axis=1)
        _, slope = self._robust(lengths / self.noise)
        directions = self._slide(differences / np.maximum(lengths, 1e-300)[:, None])
        rows = self.posed.along(state, chosen, directions)
        rows *= (weights * slope / self.noise)[:, None]
        return np.concatenate([rows, np.diag(self.posed.root_precision)])

    def information(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "s s"]:
        """Inverse covariance of the state: each match gives three coordinates, and a far one counts less."""
        differences, chosen, weights = self._matches(state)
        squared = np.square(self._slide(differences) / self.noise / self.robust_scale).sum(1)
        weights = weights / self.noise / np.sqrt(1 + squared)
        rows = self._slide(self.posed.jacobian(state, chosen)) * weights[:, None, None]
        rows = rows.reshape(-1, len(state))
        return rows.T @ rows + np.diag(np.square(self.posed.root_precision))

    def nearest(self, state: Float[np.ndarray, "s"]) -> Float[np.ndarray, "m 3"]:
        """From each observed point to its nearest model point [m]."""
        return self._matches(state)[0][: len(self.observed)]

    def _matches(self, state):
        """Model minus observed points, indices of the model points, weights."""
        key = state.tobytes()
        if self._last[0] != key:
            moved = self.posed.points(state)
            chosen = self._tree(moved).query(self.observed)[1]
            differences, weights = moved[chosen] - self.observed, np.ones(len(self.observed))
            seen = np.arange(len(self.observed))
            if len(self.visible):
                counterpart = self._observed_tree.query(moved[self.visible])[1]
                chosen = np.concatenate([chosen, self.visible])
                differences = np.concatenate([differences, moved[self.visible] - self.observed[counterpart]])
                seen = np.concatenate([seen, counterpart])
                weights = np.concatenate([weights, np.full(len(self.visible), self._coverage)])
            self._last = key, (differences, chosen, weights, seen)
        return self._last[1][:3]

    def _slide(self, rows: Float[np.ndarray, "r 3 ..."]) -> Float[np.ndarray, "r 3 ..."]:
        """Shorten the part along the observed surface."""
        if self._normals is None:
            return rows
        normals = self._normals[self._last[1][3]]
        across = np.einsum("ri,ri...->r...", normals, rows)
        normals = normals.reshape(*normals.shape, *[1] * (rows.ndim - 2))
        return self._hold * rows + (1 - self._hold) * normals * across[:, None]

    def _robust(self, lengths: Float[np.ndarray, "r"]):
        """Shortened lengths, and their derivatives.

        Their square is Cauchy's loss c^2 log(1 + (d / c)^2): far points hardly pull.
        """
        squared = np.square(lengths / self.robust_scale)
        squared = np.maximum(squared, 1e-12)  # the limits at zero are 1
        shortened = np.sqrt(np.log1p(squared) / squared)
        return lengths * shortened, 1 / ((1 + squared) * shortened)


def surface_normals(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Unit normals of the surface a cloud lies on, of either sign, from each point's neighbours."""
    from scipy.spatial import KDTree

    neighbours = points[KDTree(points).query(points, k=min(NEIGHBOURS, len(points)))[1]]
    centred = neighbours - neighbours.mean(1, keepdims=True)
    return np.linalg.eigh(np.einsum("mki,mkj->mij", centred, centred))[1][:, :, 0]


def _skew(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Matrix of the cross product: `_skew(a) @ b = a x b`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _left_jacobian(turn: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """d exp(turn) p = -[exp(turn) p]x  J  d turn (Sola, Deray, Atchuthan 2018, eq. 145)."""
    skew = _skew(turn)
    cosine, rest = _rotation_terms(turn)
    return np.eye(3) + cosine * skew + rest * skew @ skew


def _rotation_terms(turn: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """(1 - cos(a)) / a^2 and (a - sin(a)) / a^3 of the angle a."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-4:
        return 0.5, 1 / 6  # to 1e-9
    return float(1 - np.cos(angle)) / angle**2, float(angle - np.sin(angle)) / angle**3
