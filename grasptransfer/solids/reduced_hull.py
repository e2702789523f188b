"""Fewer vertices of a convex part, at the least loss of its surface."""

import itertools

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

DIRECTIONS = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if any(way)], float)


def reduced_hull(
    vertices: Float[np.ndarray, "m 3"], most: int, *, tolerance: float = 1e-4
) -> Float[np.ndarray, "_ 3"]:
    """Vertices whose hull is within `tolerance` of the hull of all, or as near as `most` vertices allow.

    The search starts from the extreme vertices along 26 directions and adds the vertex farthest outside the
    hull so far: flat faces, which a gripper presses on, get their corners first.

    Args:
        vertices: vertices of a solid [m].
        most: largest number of vertices to keep, at least 26.
        tolerance: distance between the two hulls that is good enough [m].
    """
    if len(vertices) <= most:
        return vertices
    centred = vertices - vertices.mean(0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    # The part is stretched to equal spread along its axes: in a thin part the 26 directions would otherwise
    # find the same few corners.
    round_part = centred @ axes.T / spread
    chosen = list(dict.fromkeys(np.argmax(round_part @ DIRECTIONS.T, axis=0).tolist()))
    while len(chosen) < most:
        # The hull is computed anew, since Qhull's incremental mode is less reliable; Q12 lets Qhull merge
        # faces of nearly flat points.
        faces = ConvexHull(vertices[chosen], qhull_options="Qt Q12").equations
        outside = (vertices @ faces[:, :3].T + faces[:, 3]).max(1)
        farthest = int(np.argmax(outside))
        if outside[farthest] < tolerance:
            break
        chosen.append(farthest)
    return vertices[np.sort(chosen)]
