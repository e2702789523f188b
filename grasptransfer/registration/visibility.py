"""Which points of a cloud can be seen from a viewpoint, without a surface.

Source: Katz, Tal, Basri, Direct Visibility of Point Sets, 2007: points flipped outward at a large
sphere around the viewpoint are visible where they lie on the convex hull.
"""

import numpy as np
from jaxtyping import Bool, Float

FLIP_RADIUS = 30.0  # of the farthest point; smaller hides more


def visible_points(
    points: Float[np.ndarray, "p 3"], viewpoint: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "p"]:
    """Whether each point is seen from the viewpoint, same frame [m].

    A flat cloud hides nothing of itself, so all its points are visible.
    """
    from scipy.spatial import ConvexHull, QhullError

    rays = points - viewpoint
    distance = np.linalg.norm(rays, axis=1, keepdims=True)
    if distance.min() == 0:
        return np.ones(len(points), bool)
    flipped = rays + 2 * (FLIP_RADIUS * distance.max() - distance) * rays / distance
    try:
        hull = ConvexHull(np.concatenate([flipped, np.zeros((1, 3))]))
    except QhullError:
        return np.ones(len(points), bool)
    seen = np.zeros(len(points) + 1, bool)
    seen[hull.vertices] = True
    return seen[:-1]
