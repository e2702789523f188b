"""Clouds, and fields fitted to a smooth motion of them."""

import numpy as np

from grasptransfer.registration import DeformationField

SIZE = 0.07  # m


def cloud(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)) * SIZE * [0.5, 0.4, 0.8]


def smooth_target(points: np.ndarray) -> np.ndarray:
    return points * [1.15, 0.9, 1.05] + 0.005 * np.sin(20 * points[:, [1, 2, 0]])


def fitted(seed: int = 0, *, beta: float = 1.0, count: int = 200) -> DeformationField:
    points = cloud(count, seed)
    return DeformationField.fit(points, points, smooth_target(points), beta=beta)
