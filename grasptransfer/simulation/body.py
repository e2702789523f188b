"""The object as the physics sees it: convex parts, mass, centre of mass, inertia."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.simulation.protocol import Protocol
from grasptransfer.solids.decomposition import decompose

if TYPE_CHECKING:
    import trimesh

Hull = tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, "_ 3"]]


@dataclass(frozen=True)
class Body:
    """A rigid body of convex parts, object frame.

    Args:
        hulls: vertices (v, 3) [m] and triangles (f, 3) of its convex parts.
        lowest: smallest z of all parts [m].
        mass: mass [kg].
        centre_of_mass: (3,) position in the object frame [m].
        principal_moments: (3,) moments of inertia about the centre of mass [kg m2].
        principal_axes: (3, 3) rotation from the frame of the principal axes to the object frame.
    """

    hulls: tuple[Hull, ...] = field(repr=False)
    lowest: float
    mass: float
    centre_of_mass: Float[np.ndarray, "3"]
    principal_moments: Float[np.ndarray, "3"]
    principal_axes: Float[np.ndarray, "3 3"]


def body_of(
    mesh: "trimesh.Trimesh | trimesh.Scene", protocol: Protocol, *, density: float | None = None
) -> Body:
    """The body of `mesh` (object frame, metres).

    Args:
        density: kg/m3; None: the protocol's, and the mass within its limits.

    Raises:
        MeshError: the mesh is no solid in metres.
    """
    solid = decompose(mesh)
    lightest, heaviest = protocol.mass_limits
    if density is None:
        mass = float(np.clip(protocol.density * solid.volume, lightest, heaviest))
    else:
        mass = max(density * solid.volume, lightest)
    moments, axes = np.linalg.eigh(solid.inertia * (mass / solid.volume))
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    lowest = min(float(part[:, 2].min()) for part in solid.parts)
    hulls = tuple(_hull(part) for part in solid.parts)
    return Body(hulls, lowest, mass, solid.centre_of_mass, moments, axes)


def _hull(points: Float[np.ndarray, "_ 3"]) -> Hull:
    import manifold3d

    hull = manifold3d.Manifold.hull_points(points).to_mesh64()
    vertices = np.array(hull.vert_properties)[:, :3]
    return vertices, np.array(hull.tri_verts, np.int64)


def wavefront(hulls: Sequence[Hull]) -> str:
    """The hulls as text of an OBJ file, one object each."""
    lines, start = [], 1
    for i, (vertices, triangles) in enumerate(hulls):
        lines.append(f"o part{i}")
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in vertices]
        lines += ["f {} {} {}".format(*triangle) for triangle in triangles + start]
        start += len(vertices)
    return "\n".join(lines) + "\n"
