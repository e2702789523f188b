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
    np.testing.assert_allclose(found.contacts, rim.contacts, atol=0.003)


def test_what_was_asked_of_one_grasp_is_not_done_to_the_next(session, category):
    import viser

    from grasptransfer.annotator.browser import Page

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

    from grasptransfer.annotator.browser import Page

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
