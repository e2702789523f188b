"""Order points so that neighbours in memory are neighbours in space, and box them.

The E-step skips pairs of boxes that are too far apart to matter once sigma is small.
"""

import numpy as np
from jaxtyping import Float, Int

GROUP = 8  # target points that share one list of near source boxes
BLOCK = 16  # source points in a box


def spatial_order(points: Float[np.ndarray, "m 3"], leaf: int) -> Int[np.ndarray, "m"]:
    """Indices that sort the points into the leaves of a k-d tree, each of `leaf` points in a row."""
    order = np.arange(len(points))
    length = leaf
    while length < len(points):
        length *= 2
    while length > leaf:
        node = np.arange(len(points)) // length
        sorted_points = points[order]
        starts = np.arange(0, len(points), length)
        extent = np.maximum.reduceat(sorted_points, starts) - np.minimum.reduceat(sorted_points, starts)
        widest = extent.argmax(1)[node]
        order = order[np.lexsort((sorted_points[np.arange(len(points)), widest], node))]
        length //= 2
    return order
