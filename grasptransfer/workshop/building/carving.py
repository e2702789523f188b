"""A closed surface for a cloud that has none: carve away the space that a ball can enter from outside.

The Delaunay tetrahedra of the points that a ball can enter from outside, through triangles wider than the
ball, are removed. The others are solid, and their boundary passes through the points (Edelsbrunner and Muecke
1994, alpha shapes; here without cavities, since scans are hollow).
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, KDTree, QhullError

from grasptransfer.errors import PointCloudError

# The ball's radii start at this share of the points' spacing, and grow by this factor.
FIRST, GROWTH = 0.8, 1.1
SETTLED = 1.05  # One such step lets the volume grow by less than this once the ball stays outside.

_OPPOSITE = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # face opposite to each corner


def carved_surface(points: Float[np.ndarray, "m 3"]) -> tuple[trimesh.Trimesh, float]:
    """The tightest closed surface around a cloud that a ball cannot enter.

    Args:
        points: (m, 3) [m].

    Returns:
        mesh: wound outwards [m].
        radius: radius of the ball, which cannot enter narrower hollows [m].

    Raises:
        PointCloudError: the points lie in a plane.
    """
    points = np.unique(points, axis=0)  # A point given twice says nothing of the spacing.
    try:
        delaunay = Delaunay(points)
    except QhullError as cause:
        raise PointCloudError("the points lie in a plane") from cause
    faces = delaunay.simplices[:, _OPPOSITE]
    radii = _circumradii(points[faces])
    radius = FIRST * float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))
    largest = float(np.linalg.norm(np.ptp(points, axis=0)))
    boundary, volume = _boundary(points, delaunay, radii > radius), 0.0
    # While the ball slips between the points it empties the inside: the volume leaps with the radius.
    while radius < largest:
        wider = _boundary(points, delaunay, radii > GROWTH * radius)
        grown = float(trimesh.Trimesh(points, wider, process=False).volume)
        if 0 < grown < SETTLED * volume:
            break
        boundary, volume, radius = wider, grown, GROWTH * radius
    mesh = trimesh.Trimesh(points, boundary, process=False)
    mesh.remove_unreferenced_vertices()
    return mesh, radius


def _circumradii(corners: Float[np.ndarray, "t k 3 3"]) -> Float[np.ndarray, "t k"]:
    """Of triangles; infinite where they have no area."""
    sides = corners - np.roll(corners, 1, axis=-2)
    lengths = np.linalg.norm(sides, axis=-1).prod(-1)
    double_area = np.linalg.norm(np.cross(sides[..., 0, :], sides[..., 1, :]), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(double_area > 0, lengths / (2 * double_area), np.inf)


def _boundary(points, delaunay: Delaunay, passable: Bool[np.ndarray, "t 4"]) -> Int[np.ndarray, "f 3"]:
    """Faces between the tetrahedra that a ball enters from outside and the others."""
    count = len(delaunay.simplices)
    neighbours = np.where(delaunay.neighbors < 0, count, delaunay.neighbors)  # `count` is the outside
    here = np.repeat(np.arange(count), 4).reshape(-1, 4)
    links = coo_array(
        (np.ones(passable.sum()), (here[passable], neighbours[passable])), shape=(count + 1, count + 1)
    )
    _, region = connected_components(links, directed=False)
    solid = region != region[count]  # The outside itself is not solid.
    open_ = solid[:count, None] & ~solid[neighbours]
    tetrahedron, corner = np.nonzero(open_)
    faces = delaunay.simplices[tetrahedron[:, None], _OPPOSITE[corner]]
    towards = points[delaunay.simplices[tetrahedron, corner]] - points[faces[:, 0]]
    a, b = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    inwards = (np.cross(a, b) * towards).sum(1) > 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)
