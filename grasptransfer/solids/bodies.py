"""The closed bodies of a surface, separated where they touch, share corners or are there twice.

A body whose faces share the corners of a part of the file is closed by itself. The other faces (texture
seams, triangle soups, touching bodies whose corners were merged) are joined by position: around an edge that
more than two of them share, they are paired by angle, so that the space between the two of a pair is solid.

A half-edge is one side of a face, numbered 3 * face + side; it runs from corner `side` to the next one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

SAME_ANGLE = 1e-6  # rad: faces at a smaller angle lie on one another.

Surface = tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, "_ 3"]]  # vertices and faces


@dataclass(frozen=True)
class Bodies:
    """Parts of a surface, each as vertices (v, 3) and faces (f, 3).

    Args:
        closed: the closed bodies, in the order of their first faces; each edge belongs to two faces.
        left: the faces that belong to no closed body; None if there are none.
    """

    closed: tuple[Surface, ...]
    left: Surface | None


def split_bodies(
    positions: Float[np.ndarray, "v 3"], joined: Int[np.ndarray, "f 3"], written: Int[np.ndarray, "f 3"]
) -> Bodies:
    """Separate the closed bodies of a surface; bodies and faces that are there twice count once.

    Args:
        positions: every position at which there is a corner, once [m].
        joined: faces as indices of positions, counter-clockwise from outside.
        written: the same faces as indices of the file's corners, of which several may share a position.
    """
    thick = (joined != np.roll(joined, 1, axis=1)).all(1)  # A face of two corners has no area.
    if not thick.any():
        return Bodies((), None)
    part = _labels(written[thick], int(written.max()) + 1)[written[thick][:, 0]]
    joined = joined[thick]
    once = _firsts(np.column_stack([part, _turned(joined)]))
    joined, part = joined[once], part[once]
    alone, body_of = _closed_parts(joined, part, len(positions))
    found: dict[bytes, tuple[int, Surface]] = {}
    for members in _groups(np.flatnonzero(alone), body_of):
        found.setdefault(_content(joined[members]), (members[0], _compact(positions, joined[members])))
    others = np.flatnonzero(~alone)
    others = others[_firsts(_turned(joined[others]))]
    bodies, open_ = _by_angle(positions, joined[others])
    closed = [*found.values(), *((others[first], body) for first, body in bodies)]
    closed.sort(key=lambda body: body[0])
    left = joined[others[open_]]
    return Bodies(tuple(body for _, body in closed), _compact(positions, left) if len(left) else None)


def _by_angle(
    positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[list[tuple[int, Surface]], Int[np.ndarray, "l"]]:
    """First face and surface of each closed body that pairing around edges gives, and the faces left over."""
    if not len(faces):
        return [], np.zeros(0, np.int64)
    corners = positions[faces] - positions[faces].mean((0, 1))
    if np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) >= 0:
        return _paired(positions, faces)
    # The surface is inside out: its solid is on the other side.
    bodies, open_ = _paired(positions, faces[:, ::-1])
    return [(first, (vertices, body[:, ::-1])) for first, (vertices, body) in bodies], open_


def _paired(
    positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[list[tuple[int, Surface]], Int[np.ndarray, "l"]]:
    """The same of faces that are counter-clockwise from outside."""
    pairs = _pairs(positions, faces)
    body_of = _labels(pairs // 3, len(faces))
    lone = np.ones(3 * len(faces), bool)
    lone[pairs.ravel()] = False
    is_open = np.bincount(body_of, lone.reshape(-1, 3).sum(1)) > 0
    # Corners that no pair of half-edges connects are different corners, although they share a position.
    start, end = pairs, pairs - pairs % 3 + (pairs + 1) % 3
    same = np.concatenate([np.stack([start[:, 0], end[:, 1]], 1), np.stack([end[:, 0], start[:, 1]], 1)])
    corner_of = _labels(same, 3 * len(faces)).reshape(-1, 3)
    places = np.zeros((int(corner_of.max()) + 1, 3))
    places[corner_of] = positions[faces]
    bodies = []
    for members in _groups(np.flatnonzero(~is_open[body_of]), body_of):
        split = len(np.unique(corner_of[members])) > len(np.unique(faces[members]))
        surface = _compact(places, corner_of[members]) if split else _compact(positions, faces[members])
        bodies.append((int(members[0]), surface))
    return bodies, np.flatnonzero(is_open[body_of])


def _pairs(positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "p 2"]:
    """Pairs of opposite half-edges that belong together; half-edges without partner are left out."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.minimum(start, end) * len(positions) + np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    _, first, count = np.unique(edge[order], return_index=True, return_counts=True)
    two = np.stack([order[first[count == 2]], order[first[count == 2] + 1]], 1)
    found = [two[start[two[:, 0]] == end[two[:, 1]]]]
    for i in np.flatnonzero(count > 2):
        around = order[first[i] : first[i] + count[i]]
        found.append(_pairs_around(positions, faces, around, start[around] < end[around]))
    return np.concatenate(found)


def _pairs_around(
    positions: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    around: Int[np.ndarray, "h"],
    forward: Bool[np.ndarray, "h"],
) -> Int[np.ndarray, "p 2"]:
    """Pairs among the half-edges `around` one edge; none where the surface is not closed there.

    Counter-clockwise about the edge's forward direction, a face that runs backward opens the solid, and one
    that runs forward closes it.
    """
    none = np.zeros((0, 2), np.int64)
    if 2 * forward.sum() != len(forward):
        return none
    face, side = np.divmod(around, 3)
    ends = faces[face[0], [side[0], (side[0] + 1) % 3]]
    low, high = positions[ends.min()], positions[ends.max()]
    axis = (high - low) / np.linalg.norm(high - low)
    away = positions[faces[face, (side + 2) % 3]] - low
    away -= np.outer(away @ axis, axis)
    if not np.linalg.norm(away, axis=1).all():
        return none  # A face without area has no angle.
    across = away[0] / np.linalg.norm(away[0])
    angle = np.arctan2(away @ np.cross(axis, across), away @ across) % (2 * np.pi)
    angle[angle > 2 * np.pi - SAME_ANGLE] = 0.0
    steps = np.diff(np.sort(angle)) > SAME_ANGLE
    rank = np.concatenate([[0], np.cumsum(steps)])[np.argsort(np.argsort(angle, kind="stable"))]
    # Where one body ends and the next begins at the same angle, the first one is closed first.
    order = np.lexsort((~forward, rank))
    depth = np.cumsum(np.where(forward[order], -1, 1))
    order = np.roll(order, -int(depth.argmin()) - 1)
    opened, found = [], []
    for half_edge in order:
        if not forward[half_edge]:
            opened.append(half_edge)
        else:
            found.append((around[opened.pop()], around[half_edge]))
    return np.array(found)


def _closed_parts(
    faces: Int[np.ndarray, "f 3"], part: Int[np.ndarray, "f"], corners: int
) -> tuple[Bool[np.ndarray, "f"], Int[np.ndarray, "f"]]:
    """Which faces belong to a part in which every half-edge has one partner, and the body of each such face.

    A body is what shared edges connect: bodies that share a single corner are one part of the file, but two
    bodies.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    own = np.repeat(part.astype(np.int64), 3) * corners
    names, index, which, count = np.unique(
        (own + start) * corners + end, return_index=True, return_inverse=True, return_counts=True
    )
    back = (own + end) * corners + start
    partner = np.minimum(np.searchsorted(names, back), len(names) - 1)
    good = (count[which] == 1) & (names[partner] == back) & (count[partner] == 1)
    links = np.stack([np.flatnonzero(good), index[partner[good]]], axis=1) // 3
    return np.bincount(part, (~good).reshape(-1, 3).sum(1))[part] == 0, _labels(links, len(faces))


def _labels(linked: Int[np.ndarray, "n k"], count: int) -> Int[np.ndarray, "c"]:
    """A label for each of `count` elements; elements that share a row of `linked` have the same label."""
    one = np.repeat(linked[:, 0], linked.shape[1] - 1)
    other = linked[:, 1:].ravel()
    links = coo_array((np.ones(len(one), bool), (one, other)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _groups(members: Int[np.ndarray, "m"], label: Int[np.ndarray, "f"]) -> Iterator[Int[np.ndarray, "_"]]:
    """The members of each label, in their order."""
    order = members[np.argsort(label[members], kind="stable")]
    return (group for group in np.split(order, np.flatnonzero(np.diff(label[order])) + 1) if len(group))


def _turned(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """The same faces with the smallest corner first."""
    first = faces.argmin(1)
    return faces[np.arange(len(faces))[:, None], (first[:, None] + np.arange(3)) % 3]


def _firsts(rows: Int[np.ndarray, "n k"]) -> Int[np.ndarray, "m"]:
    """Indices of the first occurrence of each row, in their order."""
    return np.sort(np.unique(rows, axis=0, return_index=True)[1])


def _content(faces: Int[np.ndarray, "f 3"]) -> bytes:
    """A key that is the same for the same faces in another order."""
    return np.unique(_turned(faces), axis=0).tobytes()


def _compact(positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Surface:
    """The surface with only those corners that its faces use."""
    used, local = np.unique(faces, return_inverse=True)
    return positions[used], local.reshape(-1, 3).astype(np.int64)
