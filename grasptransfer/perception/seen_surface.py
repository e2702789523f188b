"""Which points of a category's model are seen, with this latent at this pose: one ray through each of many
pixels, so that each point and the depth measured at its pixel lie on one line of sight."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from grasptransfer.camera import Camera
from grasptransfer.category import Category
from grasptransfer.drawing.boxes import projected_box
from grasptransfer.frames import invert

RAYS = 1500  # through the model's box; about half of them meet it


@dataclass(frozen=True)
class ShapedModel:
    """A category's canonical mesh as the latent shapes it."""

    category: Category

    def vertices(self, latent: Float[np.ndarray, "k"]) -> Float[np.ndarray, "v 3"]:
        """Of the shape with this latent, object frame [m]."""
        return self.category.vertices_by_latent.displaced(
            np.asarray(self.category.canonical.vertices), latent
        )

    def mesh(self, latent: Float[np.ndarray, "k"]) -> trimesh.Trimesh:
        """The shape with this latent, object frame [m]."""
        return trimesh.Trimesh(self.vertices(latent), self.category.canonical.faces, process=False)


@dataclass(frozen=True)
class SeenSurface:
    """Points of the model that are seen at pixels of the picture.

    Args:
        points_object: object frame [m].
        normals_object: unit, towards the camera.
        by_latent: their displacement by the latent [m].
        pixels: (u, v) at which they are seen.
    """

    points_object: Float[np.ndarray, "p 3"]
    normals_object: Float[np.ndarray, "p 3"]
    by_latent: Float[np.ndarray, "p 3 k"]
    pixels: Int[np.ndarray, "p 2"]

    def where(self, chosen: Bool[np.ndarray, "p"]) -> "SeenSurface":
        """The chosen ones."""
        return replace(self, **{name: values[chosen] for name, values in vars(self).items()})

    def sampled(self, picture: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "p"]:
        """The picture's values at the pixels."""
        return picture[self.pixels[:, 1], self.pixels[:, 0]]

    def depth(self, camera_from_object: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "p"]:
        """Along the optical axis [m]."""
        return self.points_object @ camera_from_object[2, :3] + camera_from_object[2, 3]


def see_surface(
    model: ShapedModel,
    latent: Float[np.ndarray, "k"],
    camera: Camera,
    camera_from_object: Float[np.ndarray, "4 4"],
) -> SeenSurface:
    """Cast rays on the model with this latent; no points where it is out of the picture."""
    mesh = model.mesh(latent)
    pixels = _pixel_grid(np.asarray(mesh.vertices), camera, camera_from_object)
    object_from_camera = invert(camera_from_object)
    rays = camera.unproject(pixels.astype(float), np.ones(len(pixels))) @ object_from_camera[:3, :3].T
    origins = np.tile(object_from_camera[:3, 3], (len(rays), 1))
    points, ray, face = mesh.ray.intersects_location(origins, rays, multiple_hits=False)
    corners = np.asarray(mesh.vertices)[mesh.faces[face]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    solid = length > 1e-12  # m^2: a triangle without area has no normal
    points, ray, face, corners = points[solid], ray[solid], face[solid], corners[solid]
    normals = normals[solid] / length[solid, None]
    normals *= -np.sign((normals * rays[ray]).sum(1))[:, None]
    share = trimesh.triangles.points_to_barycentric(corners, points)
    by_latent = np.einsum("pc,pcdk->pdk", share, model.category.vertices_by_latent.basis[mesh.faces[face]])
    return SeenSurface(points, normals, by_latent, pixels[ray])


def _pixel_grid(
    vertices: Float[np.ndarray, "v 3"], camera: Camera, camera_from_object: Float[np.ndarray, "4 4"]
) -> Int[np.ndarray, "p 2"]:
    """Pixels (u, v) of an even grid over what the picture shows of the model's box."""
    u0, v0, u1, v1 = projected_box(vertices, camera, camera_from_object)
    u0, v0 = max(np.ceil(u0), 0.0), max(np.ceil(v0), 0.0)
    u1, v1 = min(np.floor(u1), camera.width - 1.0), min(np.floor(v1), camera.height - 1.0)
    if u1 < u0 or v1 < v0:
        return np.zeros((0, 2), int)
    step = max(1, round(np.sqrt((u1 - u0 + 1) * (v1 - v0 + 1) / RAYS)))
    u, v = np.meshgrid(np.arange(u0, u1 + 1, step), np.arange(v0, v1 + 1, step))
    return np.stack([u.ravel(), v.ravel()], -1).astype(int)
