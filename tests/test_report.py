"""The report and the files of a result."""

import base64
import dataclasses
import html
import io
import re

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.studio import Studio, View, crop_photo, observed_view
from grasptransfer.errors import SettingsError
from grasptransfer.grasping.formats import read_grasps
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.registration import DeformationField
from grasptransfer.report.embedded import gif_uri
from grasptransfer.report.execution_table import execution_table
from grasptransfer.report.page import headline, write_page
from grasptransfer.report.pictures import Pictures, outlined
from grasptransfer.report.result_files import save_result
from grasptransfer.report.scene_view import best_of_each_label, scene_glb
from grasptransfer.simulation.outcome import Recording, TrialResult, TrialStatus


@pytest.fixture(scope="module")
def category():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def result(category):
    image, seen = see_mug(category)
    field = category.field(category.test[1])

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
        "silhouette.png",
    ]
    np.testing.assert_array_equal(np.asarray(Image.open(folder / "silhouette.png")), result.silhouette)
    back = read_grasps(folder / "grasps.yaml", gripper=result.gripper)
    assert back.object_frame == "object"
    assert [grasp.name for grasp in back.grasps] == [grasp.name for grasp in result.usable]
    for grasp, told in zip(result.usable, back.grasps, strict=True):
        # Files hold nine decimals.
        np.testing.assert_allclose(told.object_from_gripper, grasp.object_from_gripper, atol=1e-8)
    mesh = trimesh.load_mesh(folder / "reconstruction.glb", process=False)
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
    page, viewer = re.sub(r'srcdoc="[^"]*"', "", text), re.findall(r'srcdoc="([^"]*)"', text)
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    assert "http" not in page
    assert "<script" not in page
    (viewer,) = viewer
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", html.unescape(viewer))  # all is inside it
    for grasp in result.grasps:
        assert f". {grasp.name}</h3>" in text
    assert headline(result) in text
    assert "lift-shake-v1" in text
    kinds = re.findall(r'src="data:image/(\w+);base64,([^"]+)"', text)
    assert sum(kind == "gif" for kind, _ in kinds) == 1
    for kind, content in kinds:
        assert base64.b64decode(content)[:3] == {"jpeg": b"\xff\xd8\xff", "gif": b"GIF"}[kind]
    # Photograph, mask, outlines, grippers; two sides of two models; three maps; every grasp.
    assert len(kinds) == 4 + 4 + 3 + len(result.grasps) + 1


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


def test_the_best_of_each_label_comes_first(result):
    best = best_of_each_label(result.usable)
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


def test_the_scene_holds_the_reconstruction_and_the_grippers_in_the_object_frame(result):
    scene = trimesh.load_scene(io.BytesIO(scene_glb(result)), file_type="glb", process=False)
    hand = result.gripper.link_meshes(result.usable[0].opening, visual=True)
    fingers = {pad.link for pad in result.gripper.pads} & set(hand)
    others = min(3, len({grasp.label for grasp in result.usable})) - 1
    assert len(scene.geometry) == 1 + len(hand) + others * len(fingers)
    assert (scene.bounds[0] <= result.mesh.bounds[0] + 1e-6).all()
    assert (scene.bounds[1] >= result.mesh.bounds[1] - 1e-6).all()


def test_what_a_name_holds_is_shown_as_text(result, tmp_path):
    best = result.usable[0]
    source = dataclasses.replace(best.warped.source, name="<b>bold</b>")
    warped = dataclasses.replace(best.warped, source=source)
    best = dataclasses.replace(best, warped=warped, check=dataclasses.replace(best.check, reason="a < b & c"))
    text = write_page(dataclasses.replace(result, grasps=(best,)), tmp_path / "report.html").read_text()
    assert "<b>bold" not in text
    assert "&lt;b&gt;bold&lt;/b&gt;" in text
    assert "a &lt; b &amp; c" in text
