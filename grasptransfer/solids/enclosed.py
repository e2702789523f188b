"""What a surface encloses: solids of its closed bodies, without their cavities."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from grasptransfer.solids.bodies import Surface, split_bodies

if TYPE_CHECKING:
    import manifold3d
    import trimesh

SMALLEST_PART = 1e-10  # m3, a cube of half a millimetre: smaller parts are left over from cuts.


def united(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh | None":
    """The outer surface of bodies that touch, overlap or are there twice; None if the faces enclose nothing.

    Args:
        mesh: the surface [m]; several corners may share a position.
    """
    import trimesh

    solids, left = solids_of(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    if left is not None or not solids:
        return None
    whole = union_of(solids).to_mesh64()
    vertices = np.asarray(whole.vert_properties)[:, :3]
    return trimesh.Trimesh(vertices, np.asarray(whole.tri_verts).astype(np.int64), process=False)


def solids_of(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> "tuple[list[manifold3d.Manifold], Surface | None]":
    """The closed bodies of a surface with their cavities cut out, and the faces that belong to no body.

    Args:
        vertices: corners of the surface [m]; several may share a position.
        faces: corners of each face, counter-clockwise from outside.
    """
    import trimesh

    welded = trimesh.Trimesh(vertices, faces, process=False)
    welded.merge_vertices()
    bodies = split_bodies(np.asarray(welded.vertices), np.asarray(welded.faces, np.int64), faces)
    surfaces = [surface for body in bodies.closed if (surface := _manifold(*body)) is not None]
    if len(surfaces) < len(bodies.closed):
        return [], (np.asarray(welded.vertices), np.asarray(welded.faces, np.int64))
    return _with_cavities(surfaces), bodies.left


def _with_cavities(surfaces: "list[manifold3d.Manifold]") -> "list[manifold3d.Manifold]":
    """Solids of closed surfaces; a surface that is turned inwards bounds a cavity, or is just inside out."""
    solids = [surface for surface in surfaces if surface.volume() > SMALLEST_PART]
    inverted = [_reversed(surface) for surface in surfaces if surface.volume() < -SMALLEST_PART]
    if not solids:  # The whole mesh is inside out.
        return inverted
    for hole in inverted:
        if any(_same(hole, solid) for solid in solids):
            continue  # The surface is two-sided: its faces are there once outwards and once inwards.
        # A surface turned inwards bounds a cavity if a solid surrounds it; otherwise it is just inside out.
        around = [i for i, solid in enumerate(solids) if (hole - solid).volume() < 0.5 * hole.volume()]
        if not around:
            solids.append(hole)
        for i in around:
            solids[i] = solids[i] - hole
    return solids


def _same(one: "manifold3d.Manifold", other: "manifold3d.Manifold") -> bool:
    smallest = 1e-6 * one.volume()
    alike = abs(one.volume() - other.volume()) < smallest
    return alike and (one - other).volume() < smallest


def _manifold(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> "manifold3d.Manifold | None":
    import manifold3d

    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    return solid if solid.status() == manifold3d.Error.NoError else None


def _reversed(solid: "manifold3d.Manifold") -> "manifold3d.Manifold":
    mesh = solid.to_mesh64()
    reversed_solid = _manifold(
        np.asarray(mesh.vert_properties)[:, :3].copy(), np.asarray(mesh.tri_verts)[:, ::-1].astype(np.int64)
    )
    assert reversed_solid is not None
    return reversed_solid


def union_of(solids: "list[manifold3d.Manifold]") -> "manifold3d.Manifold":
    """The union of all solids."""
    import manifold3d

    return manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
