"""Fewer vertices of a convex part, at the least loss of its surface."""

import itertools

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

DIRECTIONS = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if any(way)], float)


def reduced_hull(
    vertices: Float[np.ndarray, "m 3"], most: int, *, tolerance: float = 1e-4
) -> Float[np.ndarray, "_ 3"]:
    """Vertices whose hull comes within `tolerance` of the hull of all, or as near as `most` of them allow.

    From the extremes along 26 directions on, the vertex farthest outside the hull so far is added: flat
    faces, which a gripper presses on, get their corners first.

    Args:
        vertices: of a solid [m].
        most: number of vertices, at least 26.
        tolerance: [m].
    """
    if len(vertices) <= most:
        return vertices
    centred = vertices - vertices.mean(0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    # Alike along all axes: in a thin part the 26 directions would find the same few corners.
    round_part = centred @ axes.T / spread
    chosen = list(dict.fromkeys(np.argmax(round_part @ DIRECTIONS.T, axis=0).tolist()))
    while len(chosen) < most:
        # Qhull adds points one by one less reliably; Q12 lets it merge faces of nearly flat points.
        faces = ConvexHull(vertices[chosen], qhull_options="Qt Q12").equations
        outside = (vertices @ faces[:, :3].T + faces[:, 3]).max(1)
        farthest = int(np.argmax(outside))
        if outside[farthest] < tolerance:
            break
        chosen.append(farthest)
    return vertices[np.sort(chosen)]
