"""Bodies that touch, share corners or are there twice weigh what they weigh."""

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasptransfer.grasping import Surface
from grasptransfer.solids.decomposition import decompose
from grasptransfer.solids.enclosed import united


def together(parts) -> trimesh.Trimesh:
    whole = trimesh.util.concatenate(parts)
    assert isinstance(whole, trimesh.Trimesh)
    return whole


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("GRASPTRANSFER_CACHE", str(tmp_path_factory.mktemp("cache")))


def blocks(*corners, size=(0.03, 0.02, 0.05)):
    """Boxes side by side, in steps of their size."""
    parts = []
    for corner in corners:
        part = trimesh.creation.box(size)
        part.apply_translation(np.array(corner) * size)
        parts.append(part)
    return parts


def as_written(parts):
    return together(parts)


def corners_merged(parts):
    mesh = together(parts)
    mesh.merge_vertices()
    return mesh


def triangle_soup(parts):
    mesh = together(parts)
    faces = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), faces, process=False)


def inside_out(parts):
    mesh = triangle_soup(parts)
    mesh.invert()
    return mesh


WAYS = [as_written, corners_merged, triangle_soup, inside_out]
PLACES = {
    "two that share a side": [(0, 0, 0), (0, 0, 1)],
    "four around an edge": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)],
    "two that share an edge": [(0, 0, 0), (1, 1, 0)],
    "two that share a corner": [(0, 0, 0), (1, 1, 1)],
    "a ring": [(i, j, 0) for i in range(3) for j in range(3) if (i, j) != (1, 1)],
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("places", PLACES.values(), ids=PLACES)
def test_touching_bodies_are_told_apart_however_they_are_written(places, way):
    found = decompose(way(blocks(*places)))
    assert found.watertight
    assert found.volume == pytest.approx(30e-6 * len(places), rel=1e-9)
    assert len(found.parts) == len(places)
    middle = np.mean(places, axis=0) * (0.03, 0.02, 0.05)
    np.testing.assert_allclose(found.centre_of_mass, middle, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_turning_and_moving_touching_bodies_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3)
    mesh = triangle_soup(blocks(*PLACES["four around an edge"]))
    mesh.apply_transform(pose)
    mesh = mesh.subdivide()  # more edges, at which only two faces meet
    found = decompose(mesh)
    assert found.watertight
    assert found.volume == pytest.approx(120e-6, rel=1e-6)
    assert len(found.parts) == 4


@pytest.mark.parametrize("way", [as_written, corners_merged, triangle_soup])
def test_a_body_that_is_there_twice_counts_once(way):
    (box,) = blocks((0, 0, 0))
    found = decompose(way([box, box.copy()]))
    assert found.watertight
    assert found.volume == pytest.approx(30e-6, rel=1e-9)
    assert len(found.parts) == 1


@pytest.mark.parametrize("way", [as_written, corners_merged, triangle_soup])
def test_a_body_whose_faces_are_seen_from_both_sides_counts_once(way):
    (box,) = blocks((0, 0, 0))
    other = box.copy()
    other.invert()
    found = decompose(way([box, other]))
    assert found.watertight
    assert found.volume == pytest.approx(30e-6, rel=1e-9)
    assert len(found.parts) == 1


def test_a_decomposition_and_its_original_in_one_file_weigh_what_the_original_weighs():
    (whole,) = blocks((0, 0, 0.5), size=(0.03, 0.02, 0.1))
    halves = blocks((0, 0, 0.5), (0, 0, 1.5))
    found = decompose(together([whole, *halves]))
    assert found.watertight
    assert found.volume == pytest.approx(60e-6, rel=1e-9)


def cup(staves=30, inner=0.03, outer=0.034, height=0.08, floor=0.004):
    """Convex staves around a floor that share corners, as decompositions give a cup; and its volume [m3]."""
    turn = 2 * np.pi * np.arange(staves + 1) / staves
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    parts = []
    for one, other in itertools.pairwise(ring):
        flat = np.array([inner * one, inner * other, outer * one, outer * other])
        corners = [np.column_stack([flat, np.full(4, z)]) for z in (0, height)]
        parts.append(trimesh.convex.convex_hull(np.concatenate(corners)))
    disc = [np.column_stack([inner * ring[:-1], np.full(staves, z)]) for z in (0, floor)]
    parts.append(trimesh.convex.convex_hull(np.concatenate(disc)))
    polygon = staves * np.sin(2 * np.pi / staves) / 2
    return parts, polygon * ((outer**2 - inner**2) * height + inner**2 * floor)


@pytest.mark.parametrize("way", [as_written, corners_merged, triangle_soup])
def test_a_cup_of_touching_parts_stays_hollow(way):
    parts, volume = cup()
    found = decompose(way(parts))
    assert found.watertight
    assert len(found.parts) == len(parts)
    assert found.volume == pytest.approx(volume, rel=1e-6)


def test_a_cavity_is_still_cut_out():
    outer, inner = trimesh.creation.box((0.06, 0.06, 0.06)), trimesh.creation.box((0.04, 0.04, 0.04))
    inner.invert()
    assert decompose(together([outer, inner])).volume == pytest.approx(0.06**3 - 0.04**3, rel=1e-6)


@pytest.mark.parametrize("way", [as_written, corners_merged, triangle_soup])
def test_touching_bodies_have_one_inside(way):
    mesh = way(blocks((0, 0, 0), (0, 0, 1)))
    surface = Surface(mesh)
    assert surface.is_watertight
    inside = surface.contains(np.array([[0, 0, 0], [0, 0, 0.0245], [0, 0, 0.05], [0, 0, 0.08]]))
    assert inside.tolist() == [True, True, True, False]


def test_what_encloses_nothing_is_not_united():
    box = trimesh.creation.box((0.03, 0.02, 0.05))
    box.update_faces(np.arange(12) > 0)
    assert united(box) is None
    assert not Surface(box).is_watertight
    assert united(trimesh.Trimesh([[0, 0, 0], [1, 0, 0]], [[0, 1, 1]], process=False)) is None
