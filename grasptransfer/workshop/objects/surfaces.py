"""Closed surfaces on a fixed grid: revolution, loft, sweep and rounded boxes with UV coordinates.

A surface is a stack of rings; row i, column j of two surfaces with the same numbers of rows,
columns and creases is the same point of the topology, whatever the shape. Columns run
counter-clockwise seen from the last ring, so faces wind outwards. Each end closes in a pole.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class PartSurface:
    """A watertight textured surface.

    Args:
        vertices: (v, 3) metres; repeated along the UV seam, at the poles and at creases.
        faces: (f, 3) indices, wound outwards.
        uv: (v, 2) in [0, 1]; u around, v from the first ring to the last.
        weld: (v,) index of the first vertex at the same point: `weld[faces]` is watertight.
        shading: (v,) vertices with the same number share a normal.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "v 2"]
    weld: Int[np.ndarray, "v"]
    shading: Int[np.ndarray, "v"]

    def placed(
        self,
        translation: Float[np.ndarray, "3"] | Sequence[float] = (0, 0, 0),
        rotation: Float[np.ndarray, "3 3"] | None = None,
    ) -> "PartSurface":
        """The surface turned by `rotation`, then moved by `translation` [m]."""
        turned = self.vertices if rotation is None else self.vertices @ rotation.T
        return replace(self, vertices=turned + np.asarray(translation, float))


def tube(
    rings: Float[np.ndarray, "r c 3"],
    *,
    v: Float[np.ndarray, "r"] | None = None,
    creases: Sequence[int] = (),
) -> PartSurface:
    """A surface through `rings`; the first and the last ring are poles (each all one point).

    Args:
        rings: [m], row by row.
        v: texture coordinate of each row, rising; evenly spaced if None.
        creases: rows with a sharp edge (never a pole).
    """
    rows, columns = rings.shape[:2]
    v = np.linspace(0, 1, rows) if v is None else np.asarray(v, float)
    order, faces, weld, shading, u = _grid(rows, columns, tuple(sorted(creases)))
    closed = np.concatenate([rings, rings[:, :1]], axis=1)
    vertices = closed[order].reshape(-1, 3)
    uv = np.stack(np.broadcast_arrays(u, v[order][:, None]), -1).reshape(-1, 2)
    return PartSurface(vertices, faces, uv, weld, shading)


@lru_cache(maxsize=64)
def _grid(rows: int, columns: int, creases: tuple[int, ...]):
    """Topology of a tube: rows with creases doubled, faces, weld, shading, u."""
    order = np.sort(np.concatenate([np.arange(rows), np.array(creases, int)]))
    index = np.arange(len(order) * (columns + 1)).reshape(len(order), columns + 1)
    shading = index.copy()
    shading[:, -1] = shading[:, 0]
    shading[0], shading[-1] = shading[0, 0], shading[-1, 0]
    weld = shading.copy()
    faces = []
    for i in range(len(order) - 1):
        if order[i] == order[i + 1]:
            weld[i + 1] = weld[i]
            continue
        a, b, c, d = index[i, :-1], index[i, 1:], index[i + 1, 1:], index[i + 1, :-1]
        if i > 0:  # Next to a pole only one triangle of each quad has an area.
            faces.append(np.stack([a, b, c], -1))
        if i + 2 < len(order):
            faces.append(np.stack([a, c, d], -1))
    u = np.linspace(0, 1, columns + 1)[None]
    return order, np.concatenate(faces), weld.ravel(), shading.ravel(), u


def capped(rings: Float[np.ndarray, "r c 3"]) -> Float[np.ndarray, "r2 c 3"]:
    """`rings` with a pole put at the centre of the first and of the last ring: flat ends."""
    ends = np.broadcast_to(rings[[0, -1]].mean(axis=1, keepdims=True), (2, *rings.shape[1:]))
    return np.concatenate([ends[:1], rings, ends[1:]])


def revolve(
    profile: Float[np.ndarray, "r 2"],
    columns: int,
    *,
    section: Float[np.ndarray, "c 2"] | Float[np.ndarray, "r c 2"] | None = None,
    v: Float[np.ndarray, "r"] | None = None,
    creases: Sequence[int] = (),
    start: float = 0.0,
) -> PartSurface:
    """Turn a profile about z; it begins and ends on the axis.

    Args:
        profile: radius and z of each row [m], along the outside from bottom to top.
        section: outline of unit radius that each ring follows, one for all or one a row; a circle if None.
        start: angle of the UV seam [rad]; used only for a circle.
    """
    outline = circle(columns, start) if section is None else section
    outline = np.broadcast_to(outline, (len(profile), columns, 2))
    rings = np.empty((len(profile), columns, 3))
    rings[..., :2] = outline * profile[:, None, :1]
    rings[..., 2] = profile[:, None, 1]
    return tube(rings, v=v, creases=creases)


def sweep(
    path: Float[np.ndarray, "r 3"],
    sections: Float[np.ndarray, "r c 2"],
    *,
    side: Sequence[float] = (0.0, 1.0, 0.0),
    v: Float[np.ndarray, "r"] | None = None,
) -> PartSurface:
    """Sweep `sections` along a path that lies in the plane across `side`, with flat ends.

    Args:
        path: centres [m].
        sections: offsets [m]: first across the path within its plane (side x tangent), second along `side`.
        v: texture coordinate of each of the r rows; the caps take what is left below and above.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    along_side = np.asarray(side, float)
    across = np.cross(along_side, tangent)
    rings = path[:, None] + sections[..., :1] * across[:, None] + sections[..., 1:] * along_side
    rows = np.linspace(0.04, 0.96, len(path)) if v is None else np.asarray(v, float)
    return tube(capped(rings), v=np.concatenate([[0.0], rows, [1.0]]), creases=(1, len(path)))


def loft(
    heights: Float[np.ndarray, "r"],
    sections: Float[np.ndarray, "r c 2"],
    *,
    v: Float[np.ndarray, "r"] | None = None,
    creases: Sequence[int] = (),
) -> PartSurface:
    """Level outlines [m] stacked along z, with flat ends.

    Args:
        heights: z of each row [m], rising.
        sections: outline of each row [m], counter-clockwise seen from above.
        v: texture coordinate of each row; by height if None. The caps take what is left below and above.
        creases: rows with a sharp edge.
    """
    rings = np.concatenate([sections, np.broadcast_to(heights[:, None, None], (*sections.shape[:2], 1))], -1)
    rows = np.interp(heights, heights[[0, -1]], [0.03, 0.97]) if v is None else np.asarray(v, float)
    sharp = [row + 1 for row in creases]
    return tube(capped(rings), v=np.concatenate([[0.0], rows, [1.0]]), creases=sharp)


# Turns a surface made along z to lie along +x: the first axis of a section becomes y, the second z.
ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def circle(columns: int, start: float = 0.0) -> Float[np.ndarray, "c 2"]:
    """Unit circle, counter-clockwise from angle `start` [rad]."""
    angle = start + np.arange(columns) * (2 * np.pi / columns)
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def superellipse(
    columns: int,
    half_x: float | Float[np.ndarray, "*r"],
    half_y: float | Float[np.ndarray, "*r"],
    exponent: float | Float[np.ndarray, "*r"] = 2.0,
    *,
    start: float = 0.0,
) -> Float[np.ndarray, "*r c 2"]:
    """|x / half_x|^e + |y / half_y|^e = 1, counter-clockwise from angle `start` [rad]; one or one a row.

    Exponent 2 is an ellipse, 4 a rounded rectangle, 1 a rhombus.

    Args:
        columns: number of points of the outline.
        half_x, half_y: half extents [m], one or one a row.
        exponent: e, one or one a row.
        start: angle of the first point [rad].
    """
    sizes = (np.asarray(size, float) for size in (half_x, half_y, exponent))
    half_x, half_y, exponent = np.broadcast_arrays(*sizes)
    unit = circle(columns, start)
    size = (np.abs(unit) ** exponent[..., None, None]).sum(-1) ** (-1 / exponent[..., None])
    return unit * size[..., None] * np.stack([half_x, half_y], -1)[..., None, :]


def rounded_rectangle(
    half_x: float, half_y: float, radius: float, *, corner: int = 4, edge: int = 4
) -> Float[np.ndarray, "c 2"]:
    """Rectangle with round corners, counter-clockwise from (-half_x, 0), so that u = 0.5 lies at +x.

    Args:
        half_x, half_y: half the size [m].
        radius: radius of the corners [m]; at most the smaller half.
        corner, edge: points on each corner arc (its ends included) and inside each edge (even):
            the outline has 4 (corner + edge) points.
    """
    radius = float(min(radius, half_x, half_y))
    inner = np.array([half_x - radius, half_y - radius])
    outline = []
    for quarter, sign in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        angle = (quarter + np.linspace(0, 1, corner)) * np.pi / 2
        outline.append(inner * sign + radius * np.stack([np.cos(angle), np.sin(angle)], -1))
    points = []
    for here, after in zip(outline, outline[1:] + outline[:1], strict=True):
        share = np.arange(1, edge + 1)[:, None] / (edge + 1)
        points += [here, here[-1] + share * (after[0] - here[-1])]
    # The last edge runs along x = +half_x through y = 0; opposite to its middle the outline begins.
    return np.roll(np.concatenate(points), edge // 2 + 2 * (corner + edge), axis=0)


def rounded_box(
    half_size: Sequence[float],
    *,
    radius: float,
    fillet: float,
    corner: int = 4,
    edge: int = 4,
    rows: int = 6,
    taper: float = 0.0,
) -> PartSurface:
    """A box about the origin with round upright edges and filleted rims; +x is at u = 0.5, +y at u = 0.75.

    Args:
        half_size: half extents along x, y, z [m].
        radius: radius of the upright edges [m]. fillet: of the rims at top and bottom [m].
        corner, edge: as of `rounded_rectangle`. rows: rings between the two rims.
        taper: how much narrower the top is than the bottom, as a share.
    """
    half_x, half_y, half_z = half_size
    fillet = float(min(fillet, half_x * 0.9, half_y * 0.9, half_z * 0.9))
    arc = np.linspace(0, np.pi / 2, 4)
    inset = np.concatenate([fillet * (1 - np.sin(arc)), np.zeros(rows), fillet * (1 - np.sin(arc[::-1]))])
    side = np.linspace(-half_z + fillet, half_z - fillet, rows + 2)[1:-1]
    lower = -half_z + fillet * (1 - np.cos(arc))
    z = np.concatenate([lower, side, -lower[::-1]])
    rings = np.empty((len(z), 4 * (corner + edge), 3))
    for row, (gap, height) in enumerate(zip(inset, z, strict=True)):
        shrink = 1 - taper * (height / half_z + 1) / 2
        rings[row, :, :2] = shrink * rounded_rectangle(
            half_x - gap, half_y - gap, max(radius - gap, 1e-5), corner=corner, edge=edge
        )
        rings[row, :, 2] = height
    # Sides take v from 0.2 to 0.8, the top and the bottom the rest.
    v = np.concatenate([[0.0], np.interp(z, [-half_z, half_z], [0.2, 0.8]), [1.0]])
    return tube(capped(rings), v=v)


def smooth_step(low: float, high: float, x: Float[np.ndarray, "*r"]) -> Float[np.ndarray, "*r"]:
    """Rises from 0 at `low` to 1 at `high` without a kink."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def resample(points: Float[np.ndarray, "m d"], count: int) -> Float[np.ndarray, "count d"]:
    """`count` points evenly spaced by arc length along a polyline, its ends included."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    where = np.linspace(0, length[-1], count)
    return np.stack([np.interp(where, length, column) for column in points.T], -1)
