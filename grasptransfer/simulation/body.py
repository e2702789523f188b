"""The object as the physics sees it: convex parts, mass, centre of mass, inertia."""

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from grasptransfer.simulation.protocol import Protocol
from grasptransfer.solids.decomposition import Decomposition, decompose

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class Body:
    """A rigid body of convex parts, object frame.

    Args:
        wavefront: its parts as text of an OBJ file, one object each.
        lowest: smallest z of all parts [m].
        mass: kg.
        centre_of_mass: (3,) [m].
        principal_moments: about the centre of mass, kg m2.
        principal_axes: rotation (3, 3) from their frame to the object's.
        digest: of everything above.
    """

    wavefront: str = field(repr=False)
    lowest: float
    mass: float
    centre_of_mass: Float[np.ndarray, "3"]
    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]
    digest: str


def body_of(mesh: "trimesh.Trimesh | trimesh.Scene", protocol: Protocol) -> Body:
    """The body of `mesh` (object frame, metres), with the protocol's density.

    Raises:
        MeshError: no solid in metres.
    """
    solid = decompose(mesh)
    mass = float(np.clip(protocol.density * solid.volume, *protocol.mass_limits))
    moments, axes = np.linalg.eigh(solid.inertia * (mass / solid.volume))
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    text = _wavefront(solid)
    lowest = min(float(part[:, 2].min()) for part in solid.parts)
    numbers = np.concatenate([[mass], solid.centre_of_mass, moments, axes.ravel()])
    digest = hashlib.sha256(text.encode() + numbers.tobytes()).hexdigest()[:16]
    return Body(text, lowest, mass, solid.centre_of_mass, moments, axes, digest)


def _wavefront(solid: Decomposition) -> str:
    import manifold3d

    lines, start = [], 1
    for i, part in enumerate(solid.parts):
        hull = manifold3d.Manifold.hull_points(part).to_mesh64()
        vertices = np.asarray(hull.vert_properties)[:, :3]
        lines.append(f"o part{i}")
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in vertices]
        lines += ["f {} {} {}".format(*face) for face in np.asarray(hull.tri_verts, np.int64) + start]
        start += len(vertices)
    return "\n".join(lines) + "\n"
