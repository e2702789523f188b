"""Clouds on an ellipsoid and on its smoothly bent copy [m], and the backends of CPD's E-step."""

import numpy as np

BACKENDS = ["compiled", "numpy"]
AXES = np.array([0.05, 0.04, 0.1])


def ellipsoid(count: int, seed: int) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None] * AXES


def bent(points: np.ndarray) -> np.ndarray:
    return points * [1.2, 0.9, 1.1] + 0.01 * np.sin(30 * points[:, [1, 2, 0]])


def pair(count: int = 150, *, seed: int = 0, target_count: int | None = None):
    return ellipsoid(count, seed), bent(ellipsoid(target_count or count, seed + 1000))
