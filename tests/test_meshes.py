"""Mesh files give the right mesh, or the reason that is true."""

import json

import numpy as np
import pytest
import trimesh
from trimesh.exchange.gltf import export_gltf

from grasptransfer.errors import MeshError, SceneError
from grasptransfer.meshes import MeshLimits, load_mesh, read_mesh
from grasptransfer.simulation import simulate
from grasptransfer.workshop.building.sources import prepare

SIZE = (0.07, 0.05, 0.11)
BOX = trimesh.creation.box(SIZE)


def built(path):
    return prepare(path, scale=1.0, rotation=np.eye(3)).mesh


READERS = {"load_mesh": load_mesh, "build": built}


@pytest.fixture(params=READERS)
def read(request):
    return READERS[request.param]


def written(path, mesh):
    mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".off"])
def test_every_kind_of_file_gives_its_mesh(tmp_path, suffix, read):
    mesh = read(written(tmp_path / f"box{suffix}", BOX))
    np.testing.assert_allclose(mesh.extents, SIZE, atol=1e-7)
    assert len(mesh.faces) == 12


def test_corners_that_no_face_uses_do_not_count(tmp_path, read):
    vertices = np.vstack([BOX.vertices, [[np.nan] * 3, [90.0, 0, 0]]])
    path = written(tmp_path / "loose.ply", trimesh.Trimesh(vertices, BOX.faces, process=False))
    np.testing.assert_allclose(read(path).extents, SIZE, atol=1e-7)


def test_a_mesh_far_from_its_origin_is_read_or_refused_by_its_precision(tmp_path, read):
    far = BOX.copy()
    far.apply_translation([321_000.0, 5_400_000.0, 100.0])
    text = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in far.vertices)
    text += "".join(f"f {a} {b} {c}\n" for a, b, c in far.faces + 1)
    (tmp_path / "far.obj").write_text(text)
    np.testing.assert_allclose(read(tmp_path / "far.obj").extents, SIZE, atol=1e-5)
    for suffix in (".stl", ".ply"):
        with pytest.raises(MeshError, match=r"single precision are 0\.5 apart"):
            read(written(tmp_path / f"far{suffix}", far))
    near = BOX.copy()
    near.apply_translation([40.0, 0, 0])  # 4 um
    np.testing.assert_allclose(read(written(tmp_path / "near.stl", near)).extents, SIZE, atol=1e-5)


def test_an_object_far_from_its_origin_cannot_be_executed_on():
    far = BOX.copy()
    far.apply_translation([3_000.25, 0, 0])
    with pytest.raises(MeshError, match="farther from its origin"):
        simulate([np.eye(4)], far)
    coarse = trimesh.Trimesh((far.vertices * 1000).astype(np.float32).astype(float), far.faces, process=False)
    coarse.apply_translation([0.25, 0, 0])
    with pytest.raises(MeshError, match="single precision"):
        simulate([np.eye(4)], coarse)


@pytest.mark.parametrize(
    ("extension", "name"),
    [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshoptimizer")],
)
def test_compression_that_is_not_read_is_named(tmp_path, read, extension, name, monkeypatch):
    monkeypatch.setattr("grasptransfer.meshes.find_spec", lambda name: None)
    header = json.loads(export_gltf(trimesh.Scene(BOX))["model.gltf"])
    header["extensionsRequired"] = header["extensionsUsed"] = [extension]
    for accessor in header["accessors"]:
        accessor.pop("bufferView", None)
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    with pytest.raises(MeshError, match=rf"compressed with {name}.*Export it without"):
        read(tmp_path / "a.gltf")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("point.obj", "v 1 2 3\n", "single point"),
        ("same.xyz", "0.1 0.2 0.3\n" * 70, "all its 70 points lie in one place"),
        ("same.obj", "v 1 2 3\nv 1 2 3\nv 1 2 3\nf 1 2 3\n", "all its"),
        ("empty.obj", "# nothing\n", "neither triangles nor points"),
        ("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 1\nf 1 2 3\n", "NaN"),
        ("flat.obj", "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n", "is flat"),
        ("words.stl", "these are words", "neither triangles nor points"),
        ("box.txt", "1 2 3", "known: .glb"),
    ],
)
def test_the_reason_is_the_true_one_and_the_same_for_every_reader(tmp_path, name, text, says, read):
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshError) as caught:
        read(tmp_path / name)
    assert says in str(caught.value)
    assert name in str(caught.value)


def test_a_cloud_is_no_mesh_and_says_so(tmp_path):
    np.savetxt(tmp_path / "cloud.xyz", np.random.default_rng(0).uniform(size=(80, 3)))
    assert read_mesh(tmp_path / "cloud.xyz").mesh is None
    with pytest.raises(MeshError, match="cloud of points"):
        load_mesh(tmp_path / "cloud.xyz")


@pytest.mark.parametrize(("unit", "scale"), [("millimetres", 0.001), ("centimetres", 0.01)])
def test_another_unit_is_named_and_read_with_its_scale(tmp_path, unit, scale):
    path = written(tmp_path / "a.obj", trimesh.creation.box(np.array(SIZE) / scale))
    with pytest.raises(MeshError, match=rf"{unit}.*--scale {scale:g}"):
        load_mesh(path)
    np.testing.assert_allclose(load_mesh(path, limits=MeshLimits(scale)).extents, SIZE, atol=1e-7)


def test_a_caller_chooses_the_error_and_allows_sheets(tmp_path):
    path = written(tmp_path / "sheet.obj", trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    with pytest.raises(SceneError, match=r"sheet\.obj: wall: is flat"):
        load_mesh(path, error=SceneError, key="wall")
    assert len(load_mesh(path, limits=MeshLimits(sheets=True)).faces) == 1
