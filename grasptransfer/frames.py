"""Frames, rigid transforms, and the glossary of words and axis letters.

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

| word | meaning |
| --- | --- |
| category | a kind of object whose instances differ by a smooth deformation: mug, drill |
| canonical model | the one model of a category on which grasps are annotated |
| instance | one object of a category |
| deformation field | how every point of the canonical frame moves to an instance: `points + v(points)` |
| shape space | the deformation fields of a category: a mean field and its principal modes |
| latent | coordinates of an instance in the shape space, in standard deviations |
| given pose | the `camera_from_object` that the caller passes; the fit turns it into the *refined* pose |
| prior, likelihood, posterior | what is known before the picture, what the picture says, and both together |
| offset | how far a visible canonical point is displaced [m] |
| flow | where in the picture a visible canonical point is seen [px] |
| mask | pixels where the object is seen; the *silhouette* also holds what other things hide |
| residual | prediction minus observation, in units of its standard deviation |
| E | the paper's error: mean squared distance of true surface points to the reconstruction [1e-6 m^2] |
| chamfer distance | mean distance between two surfaces, both ways [m] |
| TCP | tool centre point: the middle between the two finger pads |
| pad | the flat part of a finger that touches the object |
| opening | distance between the pads [m]; the *width* of a grasp is the opening at which both touch |
| pre-grasp | pose from which the opened gripper moves straight along +z to the grasp: the *approach* |
| usable | a grasp that passed every check and is likely enough to hold |
| score | expected success of a grasp in [0, 1] |
| trial | one execution of a grasp in a physics engine; *held* is its success |
| protocol | everything a trial does, named and versioned |

| axis | length |
| --- | --- |
| `n` | control points of a field, or source points |
| `m` | any points, or target points |
| `k` | modes of a shape space |
| `v`, `f` | vertices and faces of a mesh |
| `c` | cells of the network that show the object; candidates of a search |
| `p` | pads, pairs or points that a function picks |
| `g` | grasps |
| `s` | drawn samples; in the fit of pose and shape, its 6 + k unknowns |
| `t` | moments of a trial, or traits of a point |
| `b` | pictures of a batch, or of one object |
| `a` | pictures of one object before these |
| `h w` | rows and columns of a picture |
| `r` | rings or rows of a parametric surface, rays |
"""

import math

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from grasptransfer.errors import NOT_NUMBERS, PoseError

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
    except NOT_NUMBERS as error:
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
    b_from_a = np.zeros(a_from_b.shape)
    rotation = a_from_b[..., :3, :3].swapaxes(-1, -2)
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
    turn = rotation_vector(a_from_moved[:3, :3] @ a_from_b[:3, :3].T)
    return np.concatenate([turn, a_from_moved[:3, 3] - a_from_b[:3, 3]])


def moved(a_from_b: Float[np.ndarray, "4 4"], step: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """The pose after a turn [rad] about b's origin and a shift [m], along a's axes: what `drift` returns."""
    a_from_moved = a_from_b.copy()
    a_from_moved[:3, :3] = rotation_matrix(step[:3]) @ a_from_b[:3, :3]
    a_from_moved[:3, 3] += step[3:]
    return a_from_moved


def rotation_matrix(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation by a vector: its direction is the axis, its length the angle [rad] (Rodrigues' formula).

    A fit asks this and `rotation_vector` thousands of times; scipy's `Rotation` takes ten times as long.
    """
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.sqrt(x * x + y * y + z * z)
    # sin(a) / a and (1 - cos(a)) / a^2; np.sinc(t) is sin(pi t) / (pi t), exact at 0, too.
    first, second = np.sinc(angle / math.pi), np.sinc(angle / (2 * math.pi)) ** 2 / 2
    return np.eye(3) + first * skew + second * skew @ skew


def rotation_vector(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The axis of a rotation, as long as its angle [rad]; the inverse of `rotation_matrix`."""
    skew = (rotation - rotation.T) / 2
    along = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])  # sine of the angle, along the axis
    sine, cosine = math.sqrt(along @ along), (np.trace(rotation) - 1) / 2
    if cosine < -0.9:  # near half a turn, where the sine no longer says which way the axis points
        return Rotation.from_matrix(rotation).as_rotvec()
    return along * (math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0)


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
