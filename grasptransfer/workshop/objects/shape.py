"""A parametric object: textured watertight parts whose vertices correspond between samples."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.workshop.objects.surfaces import PartSurface


@dataclass(frozen=True)
class Material:
    """A physically based material.

    Args:
        texture: (h, w, 3 or 4) sRGB colour, and opacity as a fourth channel; row 0 is v = 1.
        metallic, roughness: in [0, 1].
    """

    texture: UInt8[np.ndarray, "h w c"]
    metallic: float = 0.0
    roughness: float = 0.6

    @staticmethod
    def plain(
        colour: Sequence[float] | Float[np.ndarray, "c"], *, metallic: float = 0.0, roughness: float = 0.6
    ) -> "Material":
        """One sRGB colour, each channel in [0, 1]; a fourth number is opacity."""
        pixel = np.clip(np.round(255 * np.asarray(colour, float)), 0, 255).astype(np.uint8)
        return Material(np.broadcast_to(pixel, (4, 4, len(pixel))).copy(), metallic, roughness)

    @cached_property
    def transparent(self) -> bool:
        """Whether light comes through somewhere."""
        return self.texture.shape[2] == 4 and bool((self.texture[..., 3] < 255).any())

    @property
    def invisible(self) -> bool:
        """Whether there is nothing to see: contents of an empty vessel."""
        return self.texture.shape[2] == 4 and not self.texture[..., 3].any()

    def pbr(self) -> PBRMaterial:
        """The material as glTF knows it."""
        from PIL import Image

        texture = self.texture if self.transparent else np.ascontiguousarray(self.texture[..., :3])
        # pyrender finds transparency in the colour factor only, not in a texture: 254 makes it blend.
        factor = [255, 255, 255, 254 if self.transparent else 255]
        return PBRMaterial(
            baseColorFactor=factor,
            baseColorTexture=Image.fromarray(texture),
            metallicFactor=float(self.metallic),
            roughnessFactor=float(self.roughness),
            alphaMode="BLEND" if self.transparent else "OPAQUE",
        )


@dataclass(frozen=True)
class Part:
    """One watertight piece of a shape.

    Args:
        name: unique within the shape.
        vertices: (v, 3) metres, object frame.
        faces, uv, weld, shading: as of `PartSurface`; faces, weld and shading are the same for all samples.
        corresponds: (v,) whether a vertex is the same physical place on every sample.
    """

    name: str
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "v 2"]
    material: Material
    corresponds: Bool[np.ndarray, "v"]
    weld: Int[np.ndarray, "v"]
    shading: Int[np.ndarray, "v"]

    @staticmethod
    def of(
        name: str, surface: PartSurface, material: Material, corresponds: Bool[np.ndarray, "v"] | bool = True
    ) -> "Part":
        """A part made of `surface`.

        Args:
            name: name of the part, unique within its shape.
            surface: geometry and UV coordinates.
            material: colours and gloss.
            corresponds: (v,) whether a vertex is the same physical place on every sample.
        """
        each = np.broadcast_to(corresponds, len(surface.vertices)).copy()
        grid = (surface.vertices, surface.faces, surface.uv)
        return Part(name, *grid, material, each, surface.weld, surface.shading)

    def solid(self) -> trimesh.Trimesh:
        """The watertight geometry; vertex i is vertex i of the part, repeated ones are left unused."""
        return trimesh.Trimesh(self.vertices, self.weld[self.faces], process=False)

    def normals(self) -> Float[np.ndarray, "v 3"]:
        """Unit normals, smooth over UV seams and sharp at creases."""
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        groups = self.shading[self.faces].T.ravel()
        weights = np.tile(across, (3, 1))  # Larger faces count more, which keeps flats next to fillets flat.
        sums = np.stack([np.bincount(groups, weights[:, i], len(self.vertices)) for i in range(3)], -1)
        normals = sums[self.shading]
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])

    def textured(self) -> trimesh.Trimesh:
        """The part as drawn: UV, material and normals."""
        visual = TextureVisuals(uv=self.uv, material=self.material.pbr())
        return trimesh.Trimesh(
            self.vertices, self.faces, vertex_normals=self.normals(), visual=visual, process=False
        )


@dataclass(frozen=True)
class ParametricObject:
    """One sample of a category, in the category's frame: metres, z up, +x front, centred bounding box.

    Args:
        category: its name.
        parameters: what it was built from, by name; moved `towards` another shape, it keeps its own.
        parts: watertight, may overlap; the same names and topology for all samples of a category.
        contents: parts inside others, such as a liquid: drawn only where the part around them is
            see-through, and no part of the geometry.
    """

    category: str
    parameters: dict = field(repr=False)
    parts: tuple[Part, ...]
    contents: tuple[Part, ...] = ()

    @cached_property
    def vertices(self) -> Float[np.ndarray, "v 3"]:
        """(v, 3) metres: all parts, one after the other."""
        return np.concatenate([part.vertices for part in self.parts])

    @cached_property
    def faces(self) -> Int[np.ndarray, "f 3"]:
        """(f, 3) welded faces of all parts: each part is watertight."""
        starts = np.cumsum([0] + [len(part.vertices) for part in self.parts[:-1]])
        welded = [part.weld[part.faces] + start for part, start in zip(self.parts, starts, strict=True)]
        return np.concatenate(welded)

    @cached_property
    def corresponds(self) -> Bool[np.ndarray, "v"]:
        """(v,) whether a vertex is the same physical place on every sample."""
        return np.concatenate([part.corresponds for part in self.parts])

    def mesh(self) -> trimesh.Trimesh:
        """Geometry of all parts; vertex i is `vertices[i]`, faces are `faces`."""
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def scene(self) -> trimesh.Scene:
        """Textured parts in drawing order: what is behind glass comes before the glass."""
        opaque = [part for part in self.parts if not part.material.transparent]
        clear = [part for part in self.parts if part.material.transparent]
        filled = [part for part in self.contents if clear and not part.material.invisible]
        inside = sorted(filled, key=lambda part: part.material.transparent)
        scene = trimesh.Scene()
        for part in (*opaque, *inside, *clear):
            scene.add_geometry(part.textured(), node_name=part.name, geom_name=part.name)
        return scene

    def towards(self, other: "ParametricObject", share: float) -> "ParametricObject":
        """This shape moved by `share` of the way to `other`; it keeps its own materials."""

        def moved(mine: tuple[Part, ...], others: tuple[Part, ...]) -> tuple[Part, ...]:
            return tuple(
                replace(a, vertices=a.vertices + share * (b.vertices - a.vertices))
                for a, b in zip(mine, others, strict=True)
            )

        contents = moved(self.contents, other.contents)
        return replace(self, parts=moved(self.parts, other.parts), contents=contents)


def centred(
    category: str, parameters: dict, parts: tuple[Part, ...], contents: tuple[Part, ...] = ()
) -> ParametricObject:
    """The shape with the centre of its bounding box at the origin.

    Args:
        category: name of the category.
        parameters: what the shape was built from, by name.
        parts: watertight parts in any frame with the category's axes [m].
        contents: parts inside others, moved alike [m].
    """
    points = np.concatenate([part.vertices for part in parts])
    centre = (points.min(0) + points.max(0)) / 2

    def moved(pieces: tuple[Part, ...]) -> tuple[Part, ...]:
        return tuple(replace(part, vertices=part.vertices - centre) for part in pieces)

    return ParametricObject(category, parameters, moved(parts), moved(contents))
