"""The pose of an object in a photograph: session without a browser, pose files, marker boards."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.drawing.views import look_at
from grasptransfer.errors import ImageError, PoseError, SettingsError
from grasptransfer.frames import rigid
from grasptransfer.perception.estimate import ShapeEstimate
from grasptransfer.perception.pose_search import FoundPose, PoseFinder
from grasptransfer.perception.pose_search.finder import uncertainty_of
from grasptransfer.perception.pose_search.grid import poses_on_table
from grasptransfer.poses import read_pose
from grasptransfer.posing.board import INCH, Board, BoardFile
from grasptransfer.posing.files import (
    BoardSettings,
    PoseFileSettings,
    write_board,
    write_overview,
    write_proposal,
)
from grasptransfer.posing.session import PoseSession, seen_from

TURNED = POSE @ rigid(Rotation.from_rotvec([0, 0, np.pi]).as_matrix(), np.zeros(3))


@pytest.fixture(scope="module")
def mug():
    return gt.load_category("mug")


@pytest.fixture(scope="module")
def picture(mug):
    return see_mug(mug)[0]


@pytest.fixture
def session(mug, picture, monkeypatch):
    """Two proposals, the true pose and one turned by half; what finds them is tested in test_find_pose."""
    latent = np.zeros(mug.shape_space.n_modes)

    def proposals(finder, seen, **_):
        return tuple(
            FoundPose(pose, chance, uncertainty_of(pose), seen.box,
                      ShapeEstimate(mug.shape_space.field(latent), pose, latent=latent))
            for pose, chance in ((POSE, 0.7), (TURNED, 0.2))
        )  # fmt: skip

    monkeypatch.setattr(PoseFinder, "find_in", proposals)
    return PoseSession(PoseFinder(mug), picture, camera=CAMERA, box=(100.0, 60.0, 220.0, 180.0))


def test_a_session_begins_with_the_likeliest_and_any_other_can_be_chosen(session):
    np.testing.assert_allclose(session.now.camera_from_object, POSE)
    assert "70% likely" in session.sentence
    session.choose(1)
    np.testing.assert_allclose(session.now.camera_from_object, TURNED)
    with pytest.raises(SettingsError, match="no proposal"):
        session.choose(2)


def test_distance_moves_the_model_along_its_ray(session):
    before = CAMERA.project(session.now.camera_from_object[:3, 3])
    session.place_at_distance(0.9)
    assert session.distance == pytest.approx(0.9)
    np.testing.assert_allclose(CAMERA.project(session.now.camera_from_object[:3, 3]), before, atol=1e-9)


def test_a_pose_out_of_the_picture_is_refused_and_nothing_changes(session):
    away = POSE.copy()
    away[0, 3] += 5
    with pytest.raises(PoseError, match="outside"):
        session.move(away)
    np.testing.assert_allclose(session.now.camera_from_object, POSE)


def test_a_drag_is_undone_as_one_change(session):
    for step in range(5):
        pose = session.now.camera_from_object.copy()
        pose[0, 3] += 0.01 * step
        session.move(pose)
    session.end_of_move()
    session.turn((0, 0, 1), 30)
    session.undo()
    assert session.now.camera_from_object[0, 3] == pytest.approx(POSE[0, 3] + 0.1)
    session.undo()
    np.testing.assert_allclose(session.now.camera_from_object, POSE)
    session.undo()  # there is nothing left to undo


def test_the_outline_lies_around_the_object_and_follows_it(session, mug):
    true = see_mug(mug)[1].mask
    shown = session.silhouette()
    assert (shown & true).sum() / (shown | true).sum() > 0.7  # another mug than the mean one
    session.place_at_distance(2 * session.distance)
    assert session.silhouette().sum() < 0.4 * shown.sum()


def test_the_picture_shown_is_no_larger_than_asked_for(session):
    assert session.overlay(longest=160).shape == (120, 160, 3)
    assert session.overlay().shape == (CAMERA.height, CAMERA.width, 3)


def test_the_pose_file_holds_pose_and_uncertainty(session, tmp_path):
    path = session.save(tmp_path / "pose.yaml")
    read = read_pose(path)
    np.testing.assert_allclose(read.camera_from_object, POSE, atol=1e-9)
    assert read.pose_sigma == pytest.approx(session.now.pose_sigma, abs=1e-12)
    assert "# proposal 2: 20% likely" in path.read_text()


def test_without_a_browser_a_proposal_is_written_as_it_is(session, tmp_path):
    settings = PoseFileSettings(
        tmp_path / "x.png", "mug", (0.0, 0.0, 9.0, 9.0), out=tmp_path / "pose.yaml", proposal=2
    )
    assert "proposal 2" in write_proposal(session, settings)
    np.testing.assert_allclose(read_pose(settings.out).camera_from_object, TURNED, atol=1e-9)
    write_overview(session, tmp_path / "overview.png")
    assert Image.open(tmp_path / "overview.png").size == (2 * CAMERA.width, CAMERA.height)
    with pytest.raises(SettingsError, match="proposal"):
        write_proposal(session, replace(settings, proposal=3))


def test_the_page_follows_what_a_person_does_and_answers_wrong_places(session, tmp_path):
    import viser

    from grasptransfer.posing.page import PosePage

    server = viser.ViserServer(host="127.0.0.1", port=8931, verbose=False)
    try:
        page = PosePage(server, session, tmp_path / "pose.yaml")
        assert "70% likely" in page.status.content
        page._later(lambda: page._turned("half turn"))
        page.refresh()
        np.testing.assert_allclose(session.now.camera_from_object, TURNED, atol=1e-9)
        np.testing.assert_allclose(page._pose(), TURNED, atol=1e-6)  # arrows and rings went along
        page.distance.value = 0.7
        page._typed()
        page.refresh()
        assert session.distance == pytest.approx(0.7)
        away = POSE.copy()
        away[0, 3] += 5
        page._later(lambda: page._changed(lambda: session.move(away)))
        page.refresh()
        assert "outside" in page.status.content
        page._later(page._save)
        page.refresh()
        assert page.saved
        written = read_pose(page.path).camera_from_object
        np.testing.assert_allclose(written, session.now.camera_from_object, atol=1e-9)
    finally:
        server.stop()


def test_sides_are_named_as_the_object_has_them():
    assert seen_from(look_at(1.0, np.deg2rad(30), np.deg2rad(20))) == (
        "seen from 30 degrees to the left of its front, 20 above"
    )
    assert "90 degrees to the right" in seen_from(look_at(1.0, np.deg2rad(-90), 0.3))


def test_on_a_table_every_heading_stands_on_it_and_lies_behind_the_box(mug):
    points = np.asarray(mug.canonical.vertices)
    table = look_at(0.6, 0.4, 0.5)
    box = (150.0, 90.0, 190.0, 140.0)
    for pose in poses_on_table(points, CAMERA, table, box):
        placed = points @ pose[:3, :3].T + pose[:3, 3]
        heights = (placed - table[:3, 3]) @ table[:3, 2]
        assert heights.min() == pytest.approx(0, abs=1e-9)
        np.testing.assert_allclose(CAMERA.project(pose[:3, 3]), [170, 115], atol=1e-6)
    with pytest.raises(PoseError, match="camera_from_table"):
        poses_on_table(points, CAMERA, table @ np.diag([1.0, -1, -1, 1]), box)


@pytest.fixture(scope="module")
def board():
    pytest.importorskip("cv2", reason="the extra board is not installed")
    return Board(BoardFile())


def photograph(board: Board, camera: gt.Camera, camera_from_table: np.ndarray) -> np.ndarray:
    """The board as a camera sees it: each pixel's ray meets the paper somewhere."""
    paper = board.picture(dots_per_inch=120)
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.unproject(np.stack([u, v], -1), np.ones(u.shape))
    up, point = camera_from_table[:3, 2], camera_from_table[:3, 3]
    on_table = (rays * ((point @ up) / (rays @ up))[..., None] - point) @ camera_from_table[:3, :3]
    per_metre = 120 / INCH
    columns = np.floor(on_table[..., 0] * per_metre + paper.shape[1] / 2).astype(int)
    rows = np.floor(paper.shape[0] / 2 - on_table[..., 1] * per_metre).astype(int)
    inside = (columns >= 0) & (columns < paper.shape[1]) & (rows >= 0) & (rows < paper.shape[0])
    grey = np.full(u.shape, 190, np.uint8)
    grey[inside] = paper[rows[inside], columns[inside]]
    return np.repeat(grey[..., None], 3, axis=2)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.3, 0.7), (-2.0, 1.2)])
def test_a_board_gives_the_pose_of_its_table(board, azimuth, elevation):
    camera = gt.Camera.from_fov(1280, 960, np.deg2rad(50))
    table = look_at(0.55, azimuth, elevation, roll=0.1)
    seen = photograph(board, camera, table)
    seen[400:520, 560:680] = 90  # an object stands on it
    found = board.find(seen, camera)
    # A quarter of a pixel at 0.55 m is 0.1 mm across; along the ray and in tilt it counts a few times more.
    assert np.linalg.norm(found[:3, 3] - table[:3, 3]) < 2e-3
    assert np.rad2deg(Rotation.from_matrix(found[:3, :3].T @ table[:3, :3]).magnitude()) < 0.5


def test_a_picture_without_board_says_so(board):
    with pytest.raises(ImageError, match="too few corners"):
        board.find(np.full((240, 320, 3), 120, np.uint8), CAMERA)


def test_a_printed_board_has_true_size_and_its_file_describes_it(tmp_path):
    pytest.importorskip("cv2", reason="the extra board is not installed")
    description = write_board(BoardSettings(out=tmp_path / "board.png", columns=7, rows=5, square=0.03))
    page = Image.open(tmp_path / "board.png")
    dark = np.nonzero(np.asarray(page) < 128)
    width = (dark[1].max() - dark[1].min() + 1) / page.info["dpi"][0] * INCH
    assert width == pytest.approx(7 * 0.03, abs=2e-4)  # a dot or two
    assert Board.load(description).size == pytest.approx((0.21, 0.15))
    write_board(BoardSettings(out=tmp_path / "board.pdf"))
    assert b"MediaBox [ 0 0 841.92 595.2" in (tmp_path / "board.pdf").read_bytes()  # A4 in points


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"square": 0.05}, "square"),
        ({"columns": 28, "rows": 28, "square": 0.005}, "columns"),
        ({"paper": "b7"}, "paper"),
        ({"columns": 2}, "columns"),
    ],
)
def test_a_board_that_cannot_be_printed_is_refused(tmp_path, settings, key):
    pytest.importorskip("cv2", reason="the extra board is not installed")
    with pytest.raises(SettingsError, match=key):
        write_board(BoardSettings(out=tmp_path / "board.pdf", **settings))
    assert not list(tmp_path.iterdir())
