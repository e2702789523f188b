"""Which face of a mesh each pixel of a picture shows, and how far away: a compiled z-buffer.

A transfer asks this some ten times, of meshes that change each time: OpenGL would spend most of the time
on setting its scene up, and be bound to one thread.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from grasptransfer.camera import Camera
from grasptransfer.frames import transform_points

NEAREST = 1e-3  # m before the camera: faces that come nearer are left out


@dataclass(frozen=True)
class VisibleFaces:
    """What the pixels of a picture show.

    Args:
        face: number of the face whose point is seen at each pixel's centre; -1 where there is none.
        share: barycentric coordinates of that point on its face; 0 where there is none.
        depth: along the optical axis [m]; 0 where there is none.
    """

    face: Int[np.ndarray, "h w"]
    share: Float[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]

    @property
    def mask(self) -> Bool[np.ndarray, "h w"]:
        """(h, w) where the mesh is."""
        return self.face >= 0


def visible_faces(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
) -> VisibleFaces:
    """See a mesh (object frame, metres), from both sides of its faces, through every pixel's centre.

    In a pinhole picture the inverse of depth is linear over a face, and so is each corner's share of it
    (any book on computer graphics: perspective-correct interpolation).
    """
    u, v, inverse = _projected(vertices, camera, camera_from_object)
    face, nearest, share = _buffers(camera)
    _draw(u, v, inverse, np.ascontiguousarray(faces, np.int64), face, nearest, share, False)
    depth = np.divide(1, nearest, out=np.zeros(face.shape), where=face >= 0)
    return VisibleFaces(face, share, depth)


def visible_mask(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
) -> Bool[np.ndarray, "h w"]:
    """(h, w) where `visible_faces` sees the mesh, in less than half of the time."""
    u, v, inverse = _projected(vertices, camera, camera_from_object)
    face, nearest, share = _buffers(camera)
    _draw(u, v, inverse, np.ascontiguousarray(faces, np.int64), face, nearest, share, True)
    return face >= 0


def _buffers(
    camera: Camera,
) -> tuple[Int[np.ndarray, "h w"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w 3"]]:
    """Of an empty picture: no face, the inverse depth of infinity, no shares."""
    size = (camera.height, camera.width)
    return np.full(size, -1), np.zeros(size), np.zeros((*size, 3))


def _projected(
    vertices, camera: Camera, camera_from_object
) -> tuple[Float[np.ndarray, "v"], Float[np.ndarray, "v"], Float[np.ndarray, "v"]]:
    """Pixels (u, v) of the vertices and their inverse depths [1/m]."""
    seen = transform_points(camera_from_object, vertices)
    inverse = 1 / np.maximum(seen[:, 2], NEAREST)
    u = camera.fx * seen[:, 0] * inverse + camera.cx
    v = camera.fy * seen[:, 1] * inverse + camera.cy
    return u, v, inverse


@njit(nogil=True, cache=True, error_model="numpy")
@no_type_check
def _draw(u, v, inverse, faces, face, nearest, share, any_face):
    """Keep for each pixel the face that is nearest, its inverse depth, and the corners' shares.

    Args:
        any_face: keep only the first face that each pixel shows.
    """
    height, width = face.shape
    for number in range(len(faces)):
        a, b, c = faces[number, 0], faces[number, 1], faces[number, 2]
        area = (u[b] - u[a]) * (v[c] - v[a]) - (v[b] - v[a]) * (u[c] - u[a])
        if area == 0 or max(inverse[a], inverse[b], inverse[c]) >= 1 / NEAREST:
            continue
        left = max(0, int(np.ceil(min(u[a], u[b], u[c]))))
        right = min(width - 1, int(np.floor(max(u[a], u[b], u[c]))))
        top = max(0, int(np.ceil(min(v[a], v[b], v[c]))))
        bottom = min(height - 1, int(np.floor(max(v[a], v[b], v[c]))))
        part = 1 / area
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if any_face and face[row, column] >= 0:
                    continue
                at_a = ((u[b] - column) * (v[c] - row) - (v[b] - row) * (u[c] - column)) * part
                at_b = ((u[c] - column) * (v[a] - row) - (v[c] - row) * (u[a] - column)) * part
                at_c = 1 - at_a - at_b
                if at_a < 0 or at_b < 0 or at_c < 0:
                    continue
                if any_face:
                    face[row, column] = number
                    continue
                at_a, at_b, at_c = at_a * inverse[a], at_b * inverse[b], at_c * inverse[c]
                near = at_a + at_b + at_c
                if near > nearest[row, column]:
                    nearest[row, column], face[row, column] = near, number
                    share[row, column, 0] = at_a / near
                    share[row, column, 1] = at_b / near
                    share[row, column, 2] = at_c / near
