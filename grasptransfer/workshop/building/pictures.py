"""Small shaded pictures of meshes by ray casting: no graphics card, the same bytes every time."""

import io
from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageDraw, ImageFont
from trimesh.visual import TextureVisuals
from trimesh.visual.color import uv_to_color

from grasptransfer.category.category import placed_parts

AZIMUTH, ELEVATION = np.deg2rad(35.0), np.deg2rad(22.0)
BACKGROUND = 255.0
SUPERSAMPLING = 2
LAYERS = 4  # surfaces seen through one another at most
LIGHT = np.array([0.35, 0.45, 0.82])  # from the viewer's upper left; x right, y up, z to the viewer


def picture(
    scene: trimesh.Scene | trimesh.Trimesh,
    side: int,
    *,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    extent: float | None = None,
) -> UInt8[np.ndarray, "side side 3"]:
    """Parallel projection of an upright object, centred, textured and shaded, on white.

    Args:
        side: width and height [px].
        azimuth, elevation: where the viewer is; 0, 0 is in front of the object (+x) [rad].
        extent: what the width of the picture spans [m]; None fits the object.
    """
    parts = [scene] if isinstance(scene, trimesh.Trimesh) else placed_parts(scene)
    low = np.min([part.bounds[0] for part in parts], axis=0)
    high = np.max([part.bounds[1] for part in parts], axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    axes = _viewer_axes(azimuth, elevation)
    extent = extent or 1.05 * _seen_extent(parts, (low + high) / 2, axes)
    pixels = side * SUPERSAMPLING
    across = ((np.arange(pixels) + 0.5) / pixels - 0.5) * extent / radius
    v, u = np.meshgrid(-across, across, indexing="ij")
    origins = u.reshape(-1, 1) * axes[0] + v.reshape(-1, 1) * axes[1] + 3 * axes[2]
    colour = np.full((pixels**2, 3), BACKGROUND)
    _draw(colour, [_unit(part, (low + high) / 2, radius) for part in parts], origins, axes)
    small = colour.reshape(side, SUPERSAMPLING, side, SUPERSAMPLING, 3).mean((1, 3))
    return np.clip(np.round(small), 0, 255).astype(np.uint8)


def sheet(
    pictures: Sequence[UInt8[np.ndarray, "h w 3"]], titles: Sequence[str], columns: int
) -> UInt8[np.ndarray, "height width 3"]:
    """Pictures of one size in rows, each with its title below."""
    height, width = pictures[0].shape[:2]
    label = 18
    rows = -(-len(pictures) // columns)
    page = Image.new("RGB", (columns * width, rows * (height + label)), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(12)
    for index, (one, title) in enumerate(zip(pictures, titles, strict=True)):
        left, top = index % columns * width, index // columns * (height + label)
        page.paste(Image.fromarray(one), (left, top))
        draw.text((left + width / 2, top + height + 2), title, "black", font, anchor="ma")
    return np.asarray(page)


def scatter(
    clouds: Sequence[tuple[Float[np.ndarray, "_ 3"], tuple[int, int, int]]],
    side: int,
    *,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    extent: float,
) -> UInt8[np.ndarray, "side side 3"]:
    """Point clouds in their colours, the nearer points larger and on top.

    Args:
        clouds: points [m] about the origin, and sRGB colour, of each.
        extent: what the width of the picture spans [m].
    """
    axes = _viewer_axes(azimuth, elevation)
    points = np.concatenate([cloud for cloud, _ in clouds]) @ axes.T
    colours = np.concatenate([np.tile(colour, (len(cloud), 1)) for cloud, colour in clouds])
    image = Image.new("RGB", (2 * side, 2 * side), "white")
    draw = ImageDraw.Draw(image)
    for index in np.argsort(points[:, 2], kind="stable"):
        u, v = side * (1 + 2 * points[index, :2] * [1, -1] / extent)
        size = side / 75 * (1 + 0.5 * np.clip(2 * points[index, 2] / extent, -1, 1))
        draw.ellipse((u - size, v - size, u + size, v + size), fill=tuple(int(c) for c in colours[index]))
    return np.asarray(image.resize((side, side), Image.Resampling.BOX))


def png(image: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """A picture as PNG bytes."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _viewer_axes(azimuth: float, elevation: float) -> Float[np.ndarray, "3 3"]:
    """Rows: right, up and towards the viewer, in the object's frame."""
    away = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(away, right), away])


def _seen_extent(parts, centre, axes) -> float:
    points = np.concatenate([part.vertices for part in parts]) - centre
    return float(2 * np.abs(points @ axes[:2].T).max())


def _unit(part: trimesh.Trimesh, centre, radius: float) -> trimesh.Trimesh:
    """A copy of unit size, for embree's single precision."""
    moved = part.copy()
    moved.vertices = (part.vertices - centre) / radius
    return moved


def _draw(colour, parts: list[trimesh.Trimesh], origins, axes) -> None:
    """Walk along the rays through transparent surfaces until one is opaque, mixing colours."""
    whole = trimesh.Trimesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(
            [part.faces + start for part, start in zip(parts, _starts(parts, "vertices"), strict=True)]
        ),
        process=False,
    )
    first_faces = _starts(parts, "faces")
    left = np.arange(len(origins))  # rays on their way
    passed = np.ones(len(origins))  # light that came through so far
    total = np.zeros_like(colour)
    starts = origins.copy()
    for _ in range(LAYERS):
        hit = whole.ray.intersects_first(starts[left], np.tile(-axes[2], (len(left), 1)))
        left, hit = left[hit >= 0], hit[hit >= 0]
        if not len(left):
            break
        places, weights = _meet(whole.triangles[hit], starts[left], -axes[2])
        shaded, alpha = _surface_colour(parts, first_faces, hit, weights, axes)
        total[left] += (passed[left] * alpha)[:, None] * shaded
        passed[left] *= 1 - alpha
        starts[left] = places - 1e-3 * axes[2]
        left = left[passed[left] > 0.02]
    colour[:] = total + passed[:, None] * colour


def _starts(parts, name: str) -> Int[np.ndarray, "p"]:
    return np.cumsum([0] + [len(getattr(part, name)) for part in parts[:-1]])


def _meet(corners, origins, direction):
    """Points where rays meet the planes of their triangles, and their barycentric weights."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = normals @ direction
    slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    distance = (normals * (corners[:, 0] - origins)).sum(1) / slope
    places = origins + np.clip(distance, 0, 6)[:, None] * direction
    weights = trimesh.triangles.points_to_barycentric(corners, places)
    return places, np.clip(np.nan_to_num(weights, nan=1 / 3), 0, 1)


def _surface_colour(parts, first_faces, hit, weights, axes):
    """Shaded sRGB colour in [0, 255] and opacity in [0, 1] of surface points."""
    shaded, alpha = np.empty((len(hit), 3)), np.ones(len(hit))
    owner = np.searchsorted(first_faces, hit, side="right") - 1
    for number, part in enumerate(parts):
        rows = owner == number
        if not rows.any():
            continue
        corners = part.faces[hit[rows] - first_faces[number]]
        normals = np.einsum("mc,mcd->md", weights[rows], part.vertex_normals[corners]) @ axes.T
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
        rim = 0.25 * np.abs(normals[:, 2])
        base, opacity = _base_colour(part, corners, weights[rows])
        shaded[rows] = base * np.minimum(0.3 + 0.6 * light + rim, 1.1)[:, None]
        alpha[rows] = opacity
    return shaded, alpha


def _base_colour(part, corners, weights):
    """sRGB colour in [0, 255] and opacity in [0, 1] from texture, material or vertex colours."""
    visual = part.visual
    if isinstance(visual, TextureVisuals):
        material = visual.material
        if visual.uv is not None and (texture := _texture(material)) is not None:
            uv = np.einsum("mc,mcd->md", weights, visual.uv[corners])
            rgba = uv_to_color(uv, texture).astype(float)
        else:
            rgba = np.tile(np.asarray(material.main_color, float), (len(corners), 1))
        see_through = getattr(material, "alphaMode", None) == "BLEND"
        return rgba[:, :3], rgba[:, 3] / 255 if see_through else np.ones(len(corners))
    rgba = visual.vertex_colors[corners].astype(float)
    return np.einsum("mc,mcd->md", weights, rgba)[:, :3], np.ones(len(corners))


def _texture(material) -> Image.Image | None:
    image = getattr(material, "baseColorTexture", None)
    return getattr(material, "image", None) if image is None else image
