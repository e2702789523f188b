"""Building a category from a user's meshes and clouds: refusals, repairs, the result, resumption."""

import shutil
import struct

import numpy as np
import pytest
import trimesh
from vases import build_vases, vase, write_vases

from grasptransfer.category_check import check_category
from grasptransfer.errors import CategoryError, MeshError, PointCloudError, SettingsError
from grasptransfer.workshop.building import BuildSettings, build_category
from grasptransfer.workshop.building.carving import carved_surface
from grasptransfer.workshop.building.category_page import category_page
from grasptransfer.workshop.building.cloud_files import read_pcd
from grasptransfer.workshop.building.orientation import agreed_turn, best_turn
from grasptransfer.workshop.building.sources import find_sources, frame_rotation, prepare
from grasptransfer.workshop.building.tasks import thinned

STRAIGHT = np.eye(3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four train instances in as many formats, one of them a cloud, and one test instance."""
    return write_vases(tmp_path_factory.mktemp("vases"))


@pytest.fixture(scope="module")
def built(folder, tmp_path_factory):
    return build_vases(folder, tmp_path_factory.mktemp("built") / "vase")


def test_a_built_category_is_sound_but_for_grasps(built):
    assert [fault.path.name for fault in check_category(built.category.folder)] == ["grasps.yaml"]
    assert built.category.train == ("a", "b", "c", "d")
    assert built.category.test == ("e",)


def test_the_canonical_is_a_mesh_with_about_the_least_left_over(built):
    assert built.canonical == built.candidates[0].name
    meshes = [one for one in built.candidates if not one.is_cloud]
    assert built.candidates[: len(meshes)] == tuple(meshes)
    assert meshes[0].chamfer <= 1.02 * min(one.chamfer for one in meshes)


def test_registration_brings_the_canonical_nearer(built):
    for one in built.registrations:
        if one.name == built.canonical:
            assert one.status == "IDENTITY"
        else:
            assert one.after.chamfer < one.before.chamfer


def test_errors_of_unseen_instances_leave_out_the_canonical(built):
    assert {one.name for one in built.registrations if one.left_out_rms is None} == {"e"}
    measured = built.category.file.measured
    train = [one for one in built.registrations if not one.test and one.name != built.canonical]
    errors = 1e6 * np.array([one.fitted_error for one in train])
    assert measured["leave_one_out_error_um2"] == pytest.approx(errors.mean(), abs=1e-4)
    assert measured["leave_one_out_error_worst_um2"] == pytest.approx(errors.max(), abs=1e-4)
    test = next(one for one in built.registrations if one.test)
    assert measured["test_error_um2"] == pytest.approx(1e6 * test.fitted_error, abs=1e-4)
    assert test.fitted_error < test.before.error


def test_explained_variance_rises_to_all_of_it(built):
    assert (np.diff(built.explained) >= 0).all()
    assert np.isclose(built.explained[-1], 1)


def test_the_page_shows_every_instance_and_needs_no_other_file(built, tmp_path):
    text = category_page(built, tmp_path / "page.html").read_text()
    for one in built.registrations:
        assert f"<h3>{one.name} " in text
    assert text.count("<img ") == 4 * 5 + 5 * min(5, built.category.settings.modes)
    assert "http" not in text.replace("http-equiv", "")


def test_an_existing_folder_is_not_replaced_unasked(built, folder):
    with pytest.raises(CategoryError, match="--overwrite"):
        build_category(BuildSettings("vase", folder, out=built.category.folder))


def test_what_a_killed_build_left_beside_a_folder_is_no_leave_to_replace_it(built, folder, tmp_path):
    out = tmp_path / "vase"
    shutil.copytree(built.category.folder, out)
    (tmp_path / ".vase.build").mkdir()
    with pytest.raises(CategoryError, match="--overwrite"):
        build_vases(folder, out)


def test_a_file_in_the_place_of_a_category_is_refused_before_any_work(folder, tmp_path):
    (tmp_path / "vase").write_text("")
    with pytest.raises(CategoryError, match="is not a folder"):
        build_vases(folder, tmp_path / "vase", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["vase"]


@pytest.mark.parametrize(
    ("options", "choices"),
    [({"canonical": "z"}, list("abcde")), ({"test": ("z",)}, list("abcde"))],
)
def test_an_unknown_instance_name_lists_the_known(folder, tmp_path, options, choices):
    with pytest.raises(CategoryError) as caught:
        build_category(BuildSettings("vase", folder, out=tmp_path / "vase", **options))
    assert caught.value.choices == choices


def test_too_few_meshes_are_refused(folder, tmp_path):
    with pytest.raises(CategoryError, match="at least 3 train"):
        build_category(BuildSettings("vase", folder, out=tmp_path / "v", test=tuple("abc")))


@pytest.mark.parametrize(
    "options",
    [
        {"scale": 0.0},
        {"workers": 0},
        {"modes": 0},
        {"front": "up"},
        {"beta": -1.0},
        {"flexibility": 2.0},
    ],
)
def test_options_out_of_range_are_named(folder, tmp_path, options):
    with pytest.raises(SettingsError) as caught:
        build_category(BuildSettings("vase", folder, out=tmp_path / "v", **options))
    assert caught.value.key in options


@pytest.mark.parametrize("name", ["", "a vase", "../vase"])
def test_a_name_that_is_no_folder_name_is_refused_before_any_work(folder, tmp_path, name):
    with pytest.raises(CategoryError, match="letters, digits"):
        build_category(BuildSettings(name, folder, out=tmp_path / "v"))
    assert not list(tmp_path.iterdir())


def test_train_and_test_folders_are_the_split(tmp_path):
    for name in ("train/a.obj", "test/b.obj"):
        (tmp_path / name).parent.mkdir()
        vase(0.1, 0.05).export(tmp_path / name)
    assert [(source.name, source.test) for source in find_sources(tmp_path)] == [("a", False), ("b", True)]


def test_meshes_beside_train_and_test_folders_are_for_training(tmp_path):
    (tmp_path / "test").mkdir()
    for name in ("a.obj", "test/b.obj"):
        vase(0.1, 0.05).export(tmp_path / name)
    assert [(source.name, source.test) for source in find_sources(tmp_path)] == [("a", False), ("b", True)]


def test_two_files_of_one_name_are_refused(tmp_path):
    for ending in ("obj", "stl"):
        vase(0.1, 0.05).export(tmp_path / f"a.{ending}")
    with pytest.raises(CategoryError, match="one name"):
        find_sources(tmp_path)


def test_a_folder_without_meshes_names_the_endings(tmp_path):
    with pytest.raises(CategoryError) as caught:
        find_sources(tmp_path)
    assert ".pcd" in (caught.value.choices or [])


@pytest.mark.parametrize(("unit", "scale"), [("millimetres", 0.001), ("centimetres", 0.01)])
def test_another_unit_is_refused_with_the_fix(tmp_path, unit, scale):
    vase(0.1 / scale, 0.05 / scale).export(tmp_path / "a.obj")
    with pytest.raises(MeshError, match=rf"{unit}.*--scale {scale:g}"):
        prepare(tmp_path / "a.obj", scale=1.0, rotation=STRAIGHT)
    mesh = prepare(tmp_path / "a.obj", scale=scale, rotation=STRAIGHT).mesh
    assert np.isclose(mesh.extents[2], 0.1)


def test_a_scale_that_makes_an_object_tiny_is_refused(tmp_path):
    vase(0.1, 0.05).export(tmp_path / "a.obj")
    with pytest.raises(MeshError, match=r"longest side is 0\.001 m.*--scale 10"):
        prepare(tmp_path / "a.obj", scale=0.01, rotation=STRAIGHT)


@pytest.mark.parametrize(
    ("vertices", "faces", "problem"),
    [
        ([[0, 0, 0], [0.1, 0, 0], [0, 0.1, np.nan], [0, 0, 0.1]], [[0, 1, 2], [0, 1, 3]], "NaN"),
        ([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]], "flat"),
        ([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], [[0, 1, 2]], "no face with an area"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_refused(tmp_path, vertices, faces, problem):
    path = tmp_path / "a.ply"
    path.write_bytes(trimesh.Trimesh(vertices, faces, process=False).export(file_type="ply"))
    with pytest.raises(MeshError, match=problem) as caught:
        prepare(path, scale=1.0, rotation=STRAIGHT)
    assert caught.value.path == path


@pytest.mark.parametrize("name", ["a.obj", "a.glb", "a.pcd", "a.xyz"])
def test_garbage_is_refused_by_name(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x00garbage\nnothing\n")
    with pytest.raises((MeshError, PointCloudError)) as caught:
        prepare(tmp_path / name, scale=1.0, rotation=STRAIGHT)
    assert caught.value.path == tmp_path / name


def test_repairs_are_made_and_told(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    faces = np.vstack([box.faces, box.faces[:2], [[0, 0, 1]]])[:, ::-1]
    trimesh.Trimesh(box.vertices + 1.0, faces, process=False).export(tmp_path / "a.ply")
    prepared = prepare(tmp_path / "a.ply", scale=1.0, rotation=STRAIGHT)
    assert prepared.mesh.is_watertight
    assert prepared.mesh.volume > 0
    assert np.allclose(prepared.mesh.bounds.sum(0), 0)
    notes = " ".join(prepared.notes)
    assert "3 faces" in notes
    assert "inside out" in notes
    assert "moved by 1732 mm" in notes


def test_the_frame_can_be_given():
    assert np.allclose(frame_rotation("+y", "+z") @ [0, 1, 0], [1, 0, 0])
    assert np.allclose(frame_rotation("+y", "+z") @ [0, 0, 1], [0, 0, 1])
    assert np.isclose(np.linalg.det(frame_rotation("-z", "+y")), 1)
    with pytest.raises(SettingsError, match="across"):
        frame_rotation("+z", "-z")


def test_a_turned_instance_is_noticed_and_a_round_one_is_not():
    def points(mesh):
        return thinned(np.asarray(trimesh.sample.sample_surface(mesh, 3000, seed=0)[0]), 250)

    straight, turned = vase(0.1, 0.05), vase(0.11, 0.05)
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1]))
    turn = best_turn(points(straight), points(turned))
    assert turn.degrees == -90
    assert "-90 degrees" in (turn.warning or "")
    assert best_turn(points(straight), points(vase(0.12, 0.055))).warning is None
    can = trimesh.creation.cylinder(0.03, 0.1)
    other = trimesh.creation.cylinder(0.035, 0.12)
    assert best_turn(points(can), points(other)).warning is None


def test_a_cloud_gets_a_closed_surface_of_nearly_its_volume():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    mesh, radius = carved_surface(np.asarray(ball.vertices))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(ball.volume, rel=1e-6)  # convex: all tetrahedra are left
    ring = trimesh.creation.torus(0.05, 0.015, major_sections=60, minor_sections=24)
    mesh, radius = carved_surface(np.asarray(ring.vertices))
    # The hole is wider than the ball, which only shaves the inner side where points are sparse.
    assert mesh.volume == pytest.approx(ring.volume, rel=0.1)
    assert radius < 0.035


POINTS = np.array([[0.1, -0.2, 0.3], [1.5, 2.5, -3.5], [0.0, 0.25, 0.125]], np.float32)


def pcd_bytes(kind: str) -> bytes:
    """The points with a normal and a label, as PCD writes them."""
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS label x y z normal\nSIZE 4 4 4 4 4\nTYPE U F F F F\n"
        f"COUNT 1 1 1 1 3\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA {kind}\n"
    ).encode()
    labels, normals = np.arange(3, dtype="<u4"), np.ones((3, 3), "<f4")
    if kind == "ascii":
        return (
            header
            + "".join(
                f"{label} {x} {y} {z} 1 1 1\n" for label, (x, y, z) in zip(labels, POINTS, strict=True)
            ).encode()
        )
    if kind == "binary":
        return header + b"".join(
            labels[i].tobytes() + POINTS[i].tobytes() + normals[i].tobytes() for i in range(3)
        )
    plain = b"".join(a.tobytes() for a in (labels, POINTS[:, 0], POINTS[:, 1], POINTS[:, 2], normals))
    # Literals, but for the last 32 of the 36 equal normals' bytes: one copy from 4 bytes back.
    packed = b"".join(bytes([len(part) - 1]) + part for part in (plain[:32], plain[32:52]))
    packed += bytes([(7 << 5) | 0, 32 - 9, 3])
    return header + struct.pack("<II", len(packed), len(plain)) + packed


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd_files_are_read_in_all_three_encodings(tmp_path, kind):
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(kind))
    assert np.allclose(read_pcd(tmp_path / "a.pcd"), POINTS)


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_a_pcd_file_that_is_cut_short_is_refused(tmp_path, kind):
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(kind)[:-14])
    with pytest.raises(PointCloudError):
        read_pcd(tmp_path / "a.pcd")


def test_one_odd_canonical_does_not_make_others_look_turned():
    def points(mesh):
        return thinned(np.asarray(trimesh.sample.sample_surface(mesh, 3000, seed=0)[0]), 250)

    straight, turned = points(vase(0.1, 0.05)), vase(0.11, 0.05)
    others = [points(vase(height, 0.05)) for height in (0.09, 0.12, 0.13)]
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1]))
    assert agreed_turn(straight, points(turned), others).degrees == -90
    assert agreed_turn(points(turned), straight, others).warning is None
