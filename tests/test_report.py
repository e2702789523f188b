"""The report, the files of a result, pose files, the annotator's session."""

import base64
import dataclasses
import io
import re

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

import grasptransfer as gt
from grasptransfer.annotator import Session
from grasptransfer.errors import GraspFileError, ImageError, MeshError, PoseError, SettingsError
from grasptransfer.frames import rigid
from grasptransfer.grasping import load_grasps
from grasptransfer.grasping.formats import read_grasps
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.rendering import Renderer
from grasptransfer.perception.views import look_at
from grasptransfer.registration import DeformationField
from grasptransfer.report import transfer_files
from grasptransfer.report.execution_table import execution_table
from grasptransfer.report.html_parts import gif_uri
from grasptransfer.report.page import headline, write_page
from grasptransfer.report.pictures import Pictures, outlined
from grasptransfer.report.pose_file import load_pose
from grasptransfer.report.result_files import save_result
from grasptransfer.report.studio import Studio, View, crop_photo, observed_view
from grasptransfer.simulation.outcome import Recording, TrialResult, TrialStatus

CAMERA = gt.Camera.from_fov(320, 240, np.deg2rad(60))
POSE = look_at(0.4, 0.6, 0.6)


@pytest.fixture(scope="module")
def category():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def result(category):
    name = category.test[1]
    with Renderer() as renderer:
        seen = renderer.render(category.instance_scene(name), CAMERA, POSE)
    image = seen.over(np.full((240, 320, 3), 120, np.uint8))
    field = category.field(name)

    def true_shape(observation):
        return ShapeEstimate(field, observation.camera_from_object, mask=seen.mask, timings={"fit": 0.01})

    return gt.GraspTransfer(category, estimator=true_shape).transfer(image, POSE, camera=CAMERA)


@pytest.fixture
def trial(result):
    moments = 5
    moves = np.tile(np.eye(4), (moments, 1, 1))
    moves[:, 2, 3] = np.linspace(0, 0.1, moments)
    best = result.usable[0]
    base = best.object_from_gripper @ np.linalg.inv(result.gripper.base_from_tcp)
    links = {
        name: moves @ best.object_from_gripper @ pose
        for name, pose in result.gripper.link_poses(best.width).items()
    }
    assert np.allclose(links[result.gripper.base_link][0], base)
    recording = Recording(np.arange(moments) / 10, ("lift",) * moments, moves, links, None)
    return TrialResult(
        best.name,
        0,
        TrialStatus.HELD,
        "rest",
        "held",
        1.2,
        0.5,
        protocol="lift-shake-v1",
        recording=recording,
    )


def test_a_saved_result_can_be_read_back(result, tmp_path):
    save_result(result, tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    assert sorted(path.name for path in folder.iterdir()) == [
        "field.npz",
        "grasps.yaml",
        "reconstruction.glb",
        "result.yaml",
    ]
    back = read_grasps(folder / "grasps.yaml", gripper=result.gripper)
    assert back.object_frame == "object"
    assert [grasp.name for grasp in back.grasps] == [grasp.name for grasp in result.usable]
    for grasp, told in zip(result.usable, back.grasps, strict=True):
        # Files hold nine decimals.
        np.testing.assert_allclose(told.canonical_from_gripper, grasp.object_from_gripper, atol=1e-8)
    mesh = trimesh.load(folder / "reconstruction.glb", force="mesh", process=False)
    np.testing.assert_allclose(mesh.vertices, result.mesh.vertices, atol=1e-7)  # glTF is float32
    points = np.asarray(result.category.canonical.vertices)[::50]
    np.testing.assert_array_equal(DeformationField.load(folder / "field.npz")(points), result.field(points))
    data = yaml.safe_load((folder / "result.yaml").read_text())
    assert list(data["grasps"]) == [grasp.name for grasp in result.grasps]
    assert all(entry["reason"] for entry in data["grasps"].values())
    np.testing.assert_allclose(data["camera_from_object"], result.camera_from_object, atol=1e-8)


def test_a_folder_that_cannot_be_written_is_named(result, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SettingsError, match="file"):
        save_result(result, tmp_path / "file" / "folder")


def test_the_page_holds_every_grasp_and_nothing_from_elsewhere(result, trial, tmp_path):
    result = dataclasses.replace(result, grasps=result.grasps[:2] + result.grasps[-1:])
    path = write_page(result, tmp_path / "report.html", trials=[trial], executed_mesh=result.mesh)
    text = path.read_text()
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", text)
    assert "http" not in text
    assert "<script" not in text
    for grasp in result.grasps:
        assert f". {grasp.name}</h3>" in text
    assert headline(result) in text
    assert "lift-shake-v1" in text
    kinds = re.findall(r'src="data:image/(\w+);base64,([^"]+)"', text)
    assert sum(kind == "gif" for kind, _ in kinds) == 1
    for kind, content in kinds:
        assert base64.b64decode(content)[:3] == {"jpeg": b"\xff\xd8\xff", "gif": b"GIF"}[kind]
    # Photograph, mask, outlines; two sides of two models; three maps; every grasp.
    assert len(kinds) == 3 + 4 + 3 + len(result.grasps) + 1


def test_deformation_maps_show_the_fields_displacement(result):
    with Renderer() as renderer:
        maps = Pictures(result, Studio(renderer)).deformation()
    largest = np.abs(result.field.displacement(np.asarray(result.category.canonical.vertices))).max(0) * 1e3
    # The visible points are some of all points, and no point of a smooth field lies far from a vertex.
    assert np.all(np.array(maps.largest_mm) <= largest + 0.5)
    assert max(maps.largest_mm) > 0.5 * largest.max()
    assert maps.limit_mm >= 0.5 * max(maps.largest_mm)


def test_the_outline_of_the_true_shape_follows_the_mask(result):
    with Renderer() as renderer:
        pictures = Pictures(result, Studio(renderer))
        inside = pictures.studio.mask(pictures.reconstruction, pictures.observed)
    mask = np.repeat(result.mask[..., None].astype(np.uint8) * 255, 3, axis=2)
    seen = crop_photo(mask, CAMERA, pictures.observed.camera)[..., 0] > 127
    # The field leaves about a millimetre, and the mask has the photograph's coarser pixels.
    assert (inside & seen).sum() / (inside | seen).sum() > 0.93


def test_a_crop_of_the_photograph_keeps_directions():
    image = np.zeros((240, 320, 3), np.uint8)
    image[100, 200] = 255
    box = gt.Camera.from_fov(320, 240, np.deg2rad(60))
    zoomed = box.crop((180.0, 90.0, 220.0, 120.0), 400, 300)
    cut = crop_photo(image, box, zoomed)[..., 0].astype(float)
    v, u = np.mgrid[0:300, 0:400]
    middle = [(cut * u).sum() / cut.sum(), (cut * v).sum() / cut.sum()]
    ray = box.unproject(np.array([200.0, 100.0]), np.array(1.0))
    np.testing.assert_allclose(middle, zoomed.project(ray), atol=0.5)  # of pixels a tenth as large


def test_an_outline_leaves_inside_and_outside_as_they_are():
    picture = np.full((60, 80, 3), 128, np.uint8)
    inside = np.zeros((60, 80), bool)
    inside[20:40, 25:55] = True
    drawn = outlined(picture, inside, (255, 0, 0))
    assert (drawn[0:12] == 128).all()
    assert (drawn[28:32, 33:47] == 128).all()
    assert (drawn[20, 30:50, 0] > 200).all()
    assert (outlined(picture, np.zeros_like(inside), (255, 0, 0)) == picture).all()


def test_an_observed_view_shows_all_of_the_meshes(result):
    view = observed_view(CAMERA, POSE, [result.mesh], width=200, height=150)
    pixels = view.pixels(np.asarray(result.mesh.vertices))
    assert pixels.min() > 0
    assert (pixels < [200, 150]).all()
    finer = View(view.camera, POSE).finer(2)
    assert (finer.camera.width, finer.camera.height) == (400, 300)
    np.testing.assert_allclose(finer.pixels(result.mesh.vertices), 2 * pixels + 0.5, atol=1e-6)


def test_a_gif_has_its_frames_and_their_time():
    frames = [np.full((20, 30, 3), shade, np.uint8) for shade in (0, 120, 240)]
    content = base64.b64decode(gif_uri(frames, seconds_per_frame=0.1).split(",", 1)[1])
    with Image.open(io.BytesIO(content)) as picture:
        assert picture.n_frames == 3
        assert picture.info["duration"] == 100


def test_pose_files_of_ours_and_of_bop_mean_the_same(tmp_path):
    ours, theirs = tmp_path / "ours.yaml", tmp_path / "bop.json"
    ours.write_text(yaml.safe_dump({"camera_from_object": POSE.tolist()}))
    rotation, translation = POSE[:3, :3].ravel().tolist(), (1000 * POSE[:3, 3]).tolist()
    theirs.write_text(yaml.safe_dump({"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": 3}))
    np.testing.assert_allclose(load_pose(ours), POSE, atol=1e-12)
    np.testing.assert_allclose(load_pose(theirs), POSE, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "mapping"),
        ("- 1", "list"),
        ("a: [1", "not valid YAML at line"),
        ("pose: 1", "camera_from_object"),
        ("camera_from_object: [1, 2]", "4 x 4"),
        ("camera_from_object: [[a]]", "numbers"),
        ("cam_R_m2c: [1, 0, 0, 0, 1, 0, 0, 0, 1]", "cam_t_m2c"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,1,600],[0,0,0,1]]", "millimetres"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,-1,0.6],[0,0,0,1]]", "reflection"),
        ("camera_from_object: [[1,0,0,0],[0,1,0,0],[0,0,1,0.6],[0,0,0,1]]\ncam_t_m2c: [0,0,0]", "two poses"),
    ],
)
def test_a_wrong_pose_file_is_explained(text, said, tmp_path):
    path = tmp_path / "pose.yaml"
    path.write_text(text)
    with pytest.raises(PoseError) as caught:
        load_pose(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_pose_file_is_named(tmp_path):
    with pytest.raises(PoseError, match="nowhere"):
        load_pose(tmp_path / "nowhere.yaml")


def test_wrong_files_of_the_transfer_command_are_explained(tmp_path):
    grey = tmp_path / "grey.png"
    Image.fromarray(np.zeros((40, 40), np.uint8)).save(grey)
    with pytest.raises(ImageError, match="16-bit"):
        transfer_files.load_depth(grey)
    with pytest.raises(MeshError, match="does not exist"):
        transfer_files.load_mesh(tmp_path / "none.obj")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(MeshError):
        transfer_files.load_mesh(tmp_path / "empty.obj")
    trimesh.creation.box([80, 80, 90]).export(tmp_path / "mm.ply")
    with pytest.raises(MeshError, match="metres"):
        transfer_files.load_mesh(tmp_path / "mm.ply")


def test_depth_pictures_are_millimetres(tmp_path):
    Image.fromarray(np.full((40, 50), 1234, np.uint16)).save(tmp_path / "depth.png")
    np.testing.assert_allclose(transfer_files.load_depth(tmp_path / "depth.png"), 1.234)


def test_files_appear_all_together_or_not_at_all(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("stays")
    with pytest.raises(RuntimeError), transfer_files.replacing_files(out) as folder:  # noqa: PT012
        (folder / "half.txt").write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
    with transfer_files.replacing_files(out) as folder:
        (folder / "whole.txt").write_text("whole")
    assert sorted(path.name for path in out.iterdir()) == ["mine.txt", "whole.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_best_of_each_label_comes_first(result):
    best = transfer_files.best_of_each_label(result.usable)
    assert {grasp.label for grasp in best} == {grasp.label for grasp in result.usable}
    for grasp in best:
        assert grasp.score == max(other.score for other in result.usable if other.label == grasp.label)
    assert best[0] is result.usable[0]


def test_the_table_counts_what_was_held():
    outcomes = [
        TrialResult("a", 0, TrialStatus.HELD, "rest", slip_mm=1.0, protocol="p", gripper="g"),
        TrialResult("a", 1, TrialStatus.SLIPPED_LIFT, "lift", slip_mm=30.0, protocol="p", gripper="g"),
        TrialResult("b", 0, TrialStatus.HELD, "rest", slip_mm=3.0, protocol="p", gripper="g"),
        TrialResult("b", 1, TrialStatus.HELD, "rest", slip_mm=5.0, protocol="p", gripper="g"),
    ]
    columns = {column.header: list(column.cells) for column in execution_table(outcomes).columns}
    assert columns["held"] == ["1/2", "2/2", "3/4"]
    assert columns["slip mm"] == ["1.0", "4.0", "3.0"]


@pytest.fixture
def session(category, tmp_path):
    return Session(category, gt.load_gripper("panda"), path=tmp_path / "grasps.yaml")


def test_annotated_grasps_survive_saving(session, category, tmp_path):
    rim = load_grasps(category.grasps_path)[0]
    session.add("edge")
    found = session.move("edge", rim.canonical_from_gripper)
    session.describe("edge", label="rim", approach_distance=0.12, confidence=0.8)
    session.turn("edge", [-30, 0, 30], point=np.array([-0.0157, 0, 0]))
    assert found.usable
    assert session.unsaved
    session.save()
    assert not session.unsaved
    back = Session(category, session.gripper, path=session.path).grasp("edge")
    assert (back.label, back.approach_distance, back.confidence) == ("rim", 0.12, 0.8)
    assert back.symmetry.turns() == (-30, 0, 30)
    np.testing.assert_allclose(back.contacts, session.grasp("edge").contacts, atol=1e-8)
    # What rays meet agrees with what a person typed from the model's dimensions.
    assert back.width == pytest.approx(rim.width, abs=0.001)
    np.testing.assert_allclose(back.contacts, rim.contacts, atol=0.003)


def test_a_new_grasp_starts_above_the_object_and_pointing_down(session, category):
    grasp = session.add("first")
    assert grasp.canonical_from_gripper[2, 3] == pytest.approx(category.canonical.bounds[1, 2] - 0.01)
    np.testing.assert_allclose(grasp.canonical_from_gripper[:3, 2], [0, 0, -1])


def test_centring_brings_the_tcp_between_its_contacts(session, category):
    pose = np.array(load_grasps(category.grasps_path)[0].canonical_from_gripper)
    pose[:3, 3] += 0.004 * pose[:3, 0]
    session.add("edge")
    before = session.move("edge", pose)
    assert abs(before.offset) > 0.003
    after = session.centre("edge")
    assert abs(after.offset) < 2e-4  # rays move with the pads, over a curved wall
    assert after.usable


def test_a_grasp_beside_the_object_touches_nothing(session):
    session.add("far")
    found = session.move("far", rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.4, 0.0, 0.0])))
    assert not found.usable
    assert found.contacts is None
    assert found.width is None


def test_the_annotator_refuses_names_that_clash(session, category):
    session.add("one")
    session.add("two", like="one")
    for name in ("one", "", "a/b"):
        with pytest.raises(SettingsError):
            session.rename("two", name)
    session.rename("one", "zero")
    assert session.names == ("zero", "two")
    session.remove("zero")
    assert session.names == ("two",)
    with pytest.raises(SettingsError, match="two"):
        session.grasp("zero")
    empty = Session(category, session.gripper, path=session.path)
    with pytest.raises(GraspFileError, match="no grasp"):
        empty.save()


def test_a_file_for_another_gripper_is_refused(category):
    with pytest.raises(GraspFileError, match="panda"):
        Session(category, gt.load_gripper("wsg50"))


def test_the_annotators_page_follows_what_is_dragged_and_typed(session, category):
    import viser

    from grasptransfer.annotator.browser import Page

    session.add("edge")
    session.move("edge", load_grasps(category.grasps_path)[0].canonical_from_gripper)
    server = viser.ViserServer(host="127.0.0.1", port=8917, verbose=False)
    try:
        page = Page(server, session)
        assert "**free**" in page.status.content
        page.controls.position = tuple(np.add(page.controls.position, [0, 0, 0.05]))
        page._dragged()
        page.refresh()
        assert "**no contact**" in page.status.content
        assert session.grasp("edge").canonical_from_gripper[2, 3] > category.canonical.bounds[1, 2]
        page._later(lambda: page._new("edge"))
        page._later(lambda: page._rename("edge"))
        page.refresh()
        assert "name of another grasp" in page.status.content
        page._later(lambda: page._rename("copy"))
        page._later(page._save)
        page.refresh()
        assert [grasp.name for grasp in load_grasps(session.path)] == ["edge", "copy"]
    finally:
        server.stop()
