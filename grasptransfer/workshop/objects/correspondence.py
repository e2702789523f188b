"""Points of the canonical model found again on a sample, through the shared topology."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from grasptransfer.workshop.objects.shape import ParametricObject

OFF_SURFACE = 1e-3  # m: a point further from the canonical surface has no counterpart
_SPACING = 0.02  # between the points by which the nearest face is found, share of the surface's size
_CANDIDATES = (8, 64)  # nearest of those points whose faces are tried: first, and where that found no contact
_CONTACT = 1e-6  # m


class SurfaceLocator:
    """Finds the face and the barycentric weights of points on a surface."""

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]):
        self._corners = vertices[faces]
        longest = np.linalg.norm(self._corners - np.roll(self._corners, 1, axis=1), axis=-1).max(1)
        spacing = _SPACING * np.linalg.norm(np.ptp(vertices, axis=0))
        steps = np.clip(np.ceil(longest / spacing).astype(int), 1, 40)
        samples, owners = [], []
        for count in np.unique(steps).tolist():
            chosen = np.flatnonzero(steps == count)
            weights = _weights_over_face(count)
            samples.append(np.einsum("sc,fcd->fsd", weights, self._corners[chosen]).reshape(-1, 3))
            owners.append(np.repeat(chosen, len(weights)))
        self._faces_of_samples = np.concatenate(owners)
        self._tree = KDTree(np.concatenate(samples))

    def locate(
        self, points: Float[np.ndarray, "m 3"]
    ) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m 3"], Float[np.ndarray, "m"]]:
        """Face, barycentric weights of the nearest surface point, and the distance to it [m]."""
        face, weights, distance = self._nearest(points, _CANDIDATES[0])
        # Where a large face meets many small ones, their points crowd out its own.
        off = np.flatnonzero(distance > _CONTACT)
        if len(off):
            face[off], weights[off], distance[off] = self._nearest(points[off], _CANDIDATES[1])
        return face, weights, distance

    def _nearest(self, points: Float[np.ndarray, "m 3"], count: int):
        candidates = self._faces_of_samples[self._tree.query(points, k=count)[1]]
        weights = _nearest_weights(self._corners[candidates], points[:, None])
        nearest = np.einsum("mkc,mkcd->mkd", weights, self._corners[candidates])
        distance = np.linalg.norm(nearest - points[:, None], axis=-1)
        best = distance.argmin(1)
        row = np.arange(len(points))
        return candidates[row, best], weights[row, best], distance[row, best]


def corresponding_points(
    canonical: ParametricObject, sample: ParametricObject, points_canonical: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "m 3"], Bool[np.ndarray, "m"]]:
    """Where points on the canonical surface lie on `sample`.

    Args:
        points_canonical: (m, 3) metres, canonical frame.

    Returns:
        points: (m, 3) metres, on the sample's surface.
        valid: (m,) False where the point is off the canonical surface or its region has no counterpart.
    """
    face, weights, distance = locator(canonical).locate(points_canonical)
    corners = canonical.faces[face]
    points = np.einsum("mc,mcd->md", weights, sample.vertices[corners])
    return points, (distance < OFF_SURFACE) & canonical.corresponds[corners].all(1)


def locator(shape: ParametricObject) -> SurfaceLocator:
    """The locator of a shape's surface, built once."""
    known = shape.__dict__.get("_locator")
    if known is None:
        # Kept beside the cached properties of the frozen shape: it lives exactly as long.
        known = shape.__dict__["_locator"] = SurfaceLocator(shape.vertices, shape.faces)
    return known


def _weights_over_face(count: int) -> Float[np.ndarray, "s 3"]:
    """Barycentric weights of points spread over a face, `count` along each edge."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    inside = i + j < count
    first, second = (i[inside] + 1 / 3) / count, (j[inside] + 1 / 3) / count
    return np.stack([1 - first - second, first, second], -1)


def _nearest_weights(
    corners: Float[np.ndarray, "m k 3 3"], points: Float[np.ndarray, "m 1 3"]
) -> Float[np.ndarray, "m k 3"]:
    """Barycentric weights of the point of each triangle nearest to `points`."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    ab, ac, ap = b - a, c - a, points - a

    def dot(p, q):
        return (p * q).sum(-1)

    d00, d01, d11, d20, d21 = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(ap, ab), dot(ap, ac)
    area = d00 * d11 - d01 * d01
    safe = np.where(area > 1e-24, area, 1.0)
    v, w = (d11 * d20 - d01 * d21) / safe, (d00 * d21 - d01 * d20) / safe
    inside = (area > 1e-24) & (v >= 0) & (w >= 0) & (v + w <= 1)
    options = [np.where(inside[..., None], np.stack([1 - v - w, v, w], -1), np.nan)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[..., i, :], corners[..., j, :] - corners[..., i, :]
        share = np.clip(dot(points - start, along) / np.maximum(dot(along, along), 1e-30), 0, 1)
        weights = np.zeros((*share.shape, 3))
        weights[..., i], weights[..., j] = 1 - share, share
        options.append(weights)
    options = np.stack(options, -2)
    off = np.einsum("mkoc,mkcd->mkod", options, corners) - points[:, :, None]
    distance = np.where(np.isnan(options[..., 0]), np.inf, (off**2).sum(-1))
    best = distance.argmin(-1)[..., None, None]
    return np.take_along_axis(options, best, -2)[..., 0, :]
