"""The annotator: its session, and its page in the browser."""

from dataclasses import replace

import numpy as np
import pytest

import grasptransfer as gt
from grasptransfer.annotator import Session
from grasptransfer.errors import GraspFileError, SettingsError
from grasptransfer.frames import rigid
from grasptransfer.grasping import load_grasps, save_grasps


@pytest.fixture(scope="module")
def category():
    return gt.load_category("mug")


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
    kept = session.grasp("edge").contacts
    assert back.contacts is not None
    assert kept is not None
    assert rim.contacts is not None
    np.testing.assert_allclose(back.contacts, kept, atol=1e-8)
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


@pytest.fixture
def of_another_model(category, tmp_path):
    """A session on grasps that say they were made on another canonical model."""
    path = tmp_path / "grasps.yaml"
    text = category.grasps_path.read_text()
    path.write_text(text.replace(category.canonical_sha256, "f" * 64))
    return Session(category, gt.load_gripper("panda"), path=path)


def test_grasps_of_another_canonical_model_are_saved_only_once_all_were_looked_at(category, of_another_model):
    session, (first, second, *others) = of_another_model, of_another_model.names
    assert session.unseen == session.names
    assert session.unsaved
    session.measure(first)
    session.move(second, session.grasp(second).canonical_from_gripper)
    session.rename(others[0], "renamed")
    assert session.unseen == ("renamed", *others[1:])
    with pytest.raises(GraspFileError, match=r"another canonical model.*renamed"):
        session.save()
    for name in session.names:
        session.measure(name)
    assert len(load_grasps(session.save(), category=category)) == len(session.names)


def test_contacts_of_another_canonical_model_are_measured_anew(category, tmp_path):
    rim = load_grasps(category.grasps_path)[0]
    other = replace(rim, width=0.03, contacts=None)
    path = save_grasps([other], tmp_path / "grasps.yaml", category="mug", canonical_sha256="f" * 64)
    found = Session(category, gt.load_gripper("panda"), path=path).grasp(rim.name)
    assert found.width == pytest.approx(rim.width, abs=0.001)
    assert found.contacts is not None
    assert rim.contacts is not None
    np.testing.assert_allclose(found.contacts, rim.contacts, atol=0.003)


def test_what_was_asked_of_one_grasp_is_not_done_to_the_next(session, category):
    import viser

    from grasptransfer.annotator.page import Page

    for name, grasp in zip(("one", "two"), load_grasps(category.grasps_path), strict=False):
        session.add(name)
        session.move(name, grasp.canonical_from_gripper)
    pose = session.grasp("two").canonical_from_gripper
    server = viser.ViserServer(host="127.0.0.1", port=8918, verbose=False)
    try:
        page = Page(server, session)
        assert page.chosen.value == "one"
        page._later(lambda: page._choose("two"))
        page.controls.position = tuple(np.add(page.controls.position, [0, 0, 0.05]))
        page._dragged()
        page.label.value = "of one"
        page.refresh()
        assert page.chosen.value == "two"
        np.testing.assert_array_equal(session.grasp("two").canonical_from_gripper, pose)
        assert session.grasp("two").label == "two"
        page.label.value = "of two"
        page.refresh()
        assert session.grasp("two").label == "of two"
    finally:
        server.stop()


def test_the_page_tells_which_grasps_of_another_model_are_still_to_see(of_another_model):
    import viser

    from grasptransfer.annotator.page import Page

    server = viser.ViserServer(host="127.0.0.1", port=8919, verbose=False)
    try:
        page = Page(server, of_another_model)
        assert f"still to see: {of_another_model.names[1]}, " in page.status.content
        page._later(page._save)
        page.refresh()
        assert "another canonical model" in page.status.content
    finally:
        server.stop()


def test_the_annotators_page_follows_what_is_dragged_and_typed(session, category):
    import viser

    from grasptransfer.annotator.page import Page

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
        assert "the check refuses edge, copy" in page.status.content
        page.refused.value = True
        page._later(page._save)
        page.refresh()
        assert [grasp.name for grasp in load_grasps(session.path)] == ["edge", "copy"]
    finally:
        server.stop()


HAND_WRITTEN = """\
# Grasps that we use at the sink.
format: isaac_grasp
format_version: 1.0
object_frame: canonical
gripper_frame: tcp
grasptransfer: {version: 1, category: mug, gripper: panda}
grasps:
  # By the wall.
  hand_over:          # for people
    position: [-0.0546, 0.0, 0.038]
    orientation: {w: 0.0, xyz: [0.0, 1.0, 0.0]}
    label: "hand-over"
  rim_left:
    label: rim
    position: [-0.0157, 0.0388, 0.0380]
    orientation: {w: 0.0, xyz: [0.70711, 0.70711, 0.0]}
"""


@pytest.fixture
def hand_written(category, tmp_path):
    path = tmp_path / "grasps.yaml"
    path.write_text(HAND_WRITTEN)
    return Session(category, gt.load_gripper("panda"), path=path)


def test_saving_keeps_comments_order_and_what_was_not_edited(hand_written, category):
    hand_written.rename("hand_over", "to_people")
    hand_written.describe("rim_left", confidence=0.5)
    hand_written.add("rim_again", like="rim_left")
    text = hand_written.save().read_text()
    assert text.startswith("# Grasps that we use at the sink.\n")
    assert "  # By the wall.\n  to_people:          # for people\n" in text
    assert 'label: "hand-over"' in text
    assert "position: [-0.0546, 0.0, 0.038]" in text
    back = load_grasps(hand_written.path, category=category)
    assert [grasp.name for grasp in back] == ["to_people", "rim_left", "rim_again"]
    assert [grasp.confidence for grasp in back] == [1.0, 0.5, 0.5]
    assert hand_written.path.with_name("grasps.yaml.bak").read_text() == HAND_WRITTEN


def test_saving_twice_changes_nothing_more(hand_written):
    hand_written.describe("rim_left", label="edge")
    first = hand_written.save().read_text()
    assert hand_written.save().read_text() == first


def test_edits_are_undone_one_by_one_and_a_drag_is_one_edit(session, category):
    session.add("edge")
    start = session.grasp("edge").canonical_from_gripper
    for height in (0.05, 0.06, 0.07):
        session.move("edge", rigid(start[:3, :3], np.array([0, 0, height])))
    session.end_of_move()
    session.move("edge", rigid(start[:3, :3], np.array([0, 0, 0.08])))
    session.describe("edge", label="rim")
    session.undo()
    assert session.grasp("edge").label == "edge"
    session.undo()
    assert session.grasp("edge").canonical_from_gripper[2, 3] == 0.07
    session.undo()
    np.testing.assert_array_equal(session.grasp("edge").canonical_from_gripper, start)
    session.undo()
    assert session.names == ()
    with pytest.raises(SettingsError, match="undo"):
        session.undo()


def test_a_refused_grasp_is_saved_only_on_purpose(session):
    session.add("far")
    session.move("far", rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.4, 0.0, 0.0])))
    with pytest.raises(GraspFileError, match="refuses far"):
        session.save()
    assert not session.path.exists()
    assert [grasp.name for grasp in load_grasps(session.save(refused=True))] == ["far"]


def test_an_installed_category_is_saved_to_the_working_folder(category, monkeypatch, tmp_path):
    from grasptransfer.annotator import document

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(document.grasptransfer, "__file__", str(category.folder.parent.parent / "x.py"))
    session = Session(category, gt.load_gripper("panda"))
    assert session.path == tmp_path / "mug_grasps.yaml"
    assert session.names == tuple(grasp.name for grasp in load_grasps(category.grasps_path))
    before = category.grasps_path.read_bytes()
    session.describe(session.names[0], label="mine")
    text = session.save().read_text()
    assert "label: mine" in text
    assert text.splitlines()[0] == before.decode().splitlines()[0]  # its comments come along
    assert category.grasps_path.read_bytes() == before


def test_a_grasp_is_tried_on_other_shapes_and_in_simulation(session, category):
    from grasptransfer.annotator.trying import on_instances, on_latent, try_out

    session.add("rim")
    session.move("rim", load_grasps(category.grasps_path)[0].canonical_from_gripper)
    shapes = on_instances(session, "rim")
    assert len(shapes) == 6
    assert sum(shape.check.usable for shape in shapes) >= 3
    same = on_latent(session, "rim", [0.0])
    larger = on_latent(session, "rim", [2.0])
    assert not np.allclose(same.mesh.extents, larger.mesh.extents, rtol=0.01)
    trial = try_out(session, "rim")
    assert trial.held
    assert trial.recording is not None


def test_the_page_moves_by_numbers_and_tries_a_grasp(session, category):
    import viser

    from grasptransfer.annotator.page import Page

    session.add("rim")
    session.move("rim", load_grasps(category.grasps_path)[0].canonical_from_gripper)
    server = viser.ViserServer(host="127.0.0.1", port=8920, verbose=False)
    try:
        page = Page(server, session)
        x, y, z = page.position.value
        page.position.value = (x, y, z + 10)
        page.refresh()
        assert session.grasp("rim").canonical_from_gripper[2, 3] == pytest.approx(z / 1e3 + 0.01, abs=1e-4)
        assert page.controls.position[2] == pytest.approx(z / 1e3 + 0.01, abs=1e-4)
        page._later(page._undo)
        page.refresh()
        assert page.position.value == (x, y, z)
        page._later(page._execute)
        page.refresh()
        assert "**held**" in page.status.content.lower()
        assert "data:image/gif" in page.film.content
        page._later(page._on_instances)
        page.refresh()
        assert "of 6" in page.status.content
    finally:
        server.stop()
