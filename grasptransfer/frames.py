"""Frames and rigid transforms.

Units are metres and radians; frames are right-handed; vectors are columns.
A rigid transform is named `a_from_b` and maps points of frame b to frame a:
`points_a = a_from_b @ points_b`. Inner names meet:
`camera_from_gripper = camera_from_object @ object_from_gripper`.

| frame | meaning |
| --- | --- |
| `world` | z up |
| `camera` | OpenCV: x right, y down, z forward |
| `canonical` | the category's model: z up, +x its front, origin at the bounding-box centre |
| `object` | the seen instance, same axes and origin rule as `canonical` |
| `gripper` | TCP between the finger pads, +z approach, +x closing direction |
| `pixel` | u right, v down; (0, 0) is the centre of the top-left pixel |

The non-rigid map from canonical to object is a *field* (`registration.DeformationField`),
never a transform.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import PoseError

ORTHONORMAL_TOLERANCE = 1e-3  # float32 files round to about 1e-7; typed-in poses to 1e-4
LARGEST_TRANSLATION = 50.0  # m; beyond it a pose was given in millimetres

# OpenGL's camera looks along -z with y up. Its own inverse.
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def check_rigid(a_from_b: object, name: str = "pose") -> Float[np.ndarray, "4 4"]:
    """Return `a_from_b` as float64 (4, 4) with an exactly orthonormal rotation.

    Raises:
        PoseError: not 4x4, not finite, a reflection, scaled or sheared, or in millimetres.
    """
    try:
        matrix = np.array(a_from_b, dtype=float)
    except (TypeError, ValueError) as error:
        raise PoseError("must be a 4x4 matrix of numbers", key=name, value=a_from_b) from error
    if matrix.shape != (4, 4):
        raise PoseError("must be a 4x4 matrix", key=name, value=matrix.shape)
    if not np.isfinite(matrix).all():
        raise PoseError("holds NaN or infinity", key=name)
    if not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-6):
        raise PoseError(
            "last row must be 0 0 0 1", key=name, value=matrix[3].tolist(), fix="Is it transposed?"
        )
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    if np.abs(stretch - 1).max() > ORTHONORMAL_TOLERANCE:
        raise PoseError(
            "rotation part is scaled or sheared; singular values must be 1",
            key=name,
            value=np.round(stretch, 5).tolist(),
        )
    if np.linalg.det(matrix[:3, :3]) < 0:
        raise PoseError("rotation part is a reflection (determinant -1)", key=name)
    distance = float(np.linalg.norm(matrix[:3, 3]))
    if distance > LARGEST_TRANSLATION:
        raise PoseError(
            "translation looks like millimetres, not metres",
            key=name,
            value=f"{distance:.1f}",
            fix="Divide the translation by 1000",
        )
    matrix[:3, :3] = left @ right
    return matrix


def rigid(
    rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """The transform with this rotation and translation [m]."""
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = rotation
    a_from_b[:3, 3] = translation
    return a_from_b


def invert(a_from_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """`b_from_a`, exactly rigid."""
    b_from_a = np.zeros_like(a_from_b)
    rotation = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    b_from_a[..., :3, :3] = rotation
    b_from_a[..., :3, 3] = -(rotation @ a_from_b[..., :3, 3:])[..., 0]
    b_from_a[..., 3, 3] = 1.0
    return b_from_a


def transform_points(
    a_from_b: Float[np.ndarray, "4 4"], points_b: Float[np.ndarray, "*m 3"]
) -> Float[np.ndarray, "*m 3"]:
    """Points of frame b, seen in frame a."""
    return points_b @ a_from_b[:3, :3].T + a_from_b[:3, 3]


def drift(
    a_from_b: Float[np.ndarray, "4 4"], a_from_moved: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6"]:
    """Turn [rad] about b's origin and shift [m], along a's axes, that take the first pose to the second."""
    turn = Rotation.from_matrix(a_from_moved[:3, :3] @ a_from_b[:3, :3].T).as_rotvec()
    return np.concatenate([turn, a_from_moved[:3, 3] - a_from_b[:3, 3]])


def moved(a_from_b: Float[np.ndarray, "4 4"], step: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """The pose after a turn [rad] about b's origin and a shift [m], along a's axes: what `drift` tells."""
    a_from_moved = a_from_b.copy()
    a_from_moved[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ a_from_b[:3, :3]
    a_from_moved[:3, 3] += step[3:]
    return a_from_moved


def rotation_angle(rotation: Float[np.ndarray, "3 3"]) -> float:
    """Angle of a rotation, radians in [0, pi]."""
    # atan2 keeps its precision near 0 and pi, where arccos of the trace loses it.
    skew = rotation - rotation.T
    sine = np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]]) / 2
    return float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))


def nearest_rotation(matrix: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """The proper rotation nearest to each matrix in the Frobenius norm (polar decomposition)."""
    left, _, right = np.linalg.svd(matrix)
    signs = np.ones(matrix.shape[:-1])
    signs[..., 2] = np.linalg.det(left @ right)
    return (left * signs[..., None, :]) @ right
