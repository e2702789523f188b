"""`transfer FOLDER`: one wrong picture does not stop the others, and what is done is not done again."""

import copy
import json
import shutil

import pytest
import yaml

from grasptransfer.category import load_category
from grasptransfer.cli.main import main
from grasptransfer.errors import ImageError, PoseError, SettingsError
from grasptransfer.poses import read_pose
from grasptransfer.report import batch as batches
from grasptransfer.report.batch import pictures_of, run_batch
from grasptransfer.report.transfer_inputs import TransferSettings

DEMO = load_category("mug").folder / "demo"
POSE = yaml.safe_load((DEMO / "pose.yaml").read_text())["camera_from_object"]


@pytest.fixture
def folder(tmp_path):
    """Two pictures and a text file that calls itself one."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for name in ("a.png", "b.png"):
        shutil.copy(DEMO / "picture.png", pictures / name)
    (pictures / "c.png").write_text("no picture")
    entries = {f"{name}.png": {"camera_from_object": POSE} for name in "abc"}
    (tmp_path / "poses.yaml").write_text(yaml.safe_dump(entries))
    return tmp_path


def _settings(folder, **changed):
    given = {"pose": (folder / "poses.yaml",), "camera": (DEMO / "camera.yaml",), "estimator": "rigid"}
    given |= changed
    return TransferSettings(image=(folder / "pictures",), category="mug", out=folder / "out", **given)


@pytest.fixture
def without_pages(monkeypatch):
    """Reports need a renderer and seconds; here a transfer leaves its result alone."""

    def written(result, trials, mesh, out):
        from grasptransfer.report.result_files import save_result
        from grasptransfer.report.transfer_files import TransferOutcome

        save_result(result, out)
        return TransferOutcome("", bool(result.usable), result, tuple(trials), out)

    monkeypatch.setattr("grasptransfer.report.transfer_files.write_outcome", written)


def test_a_bad_picture_is_named_and_the_others_are_done_once(folder, without_pages, monkeypatch, capsys):
    first = run_batch(_settings(folder))
    assert [line["image"] for line in first.lines] == ["a.png", "b.png", "c.png"]
    assert [line.get("usable", 0) > 0 for line in first.lines] == [True, True, False]
    assert "c.png: cannot be read" in first.refused[0]
    assert not first.usable
    path = folder / "out" / "results.jsonl"
    done = path.read_bytes().splitlines()[0]  # a run that was killed after the first of two equal pictures
    path.write_bytes(done + b"\n")
    assert [line["image"] for line in run_batch(_settings(folder)).lines] == ["a.png", "b.png", "c.png"]
    record = path.read_bytes()

    monkeypatch.setattr(batches, "transfer_inputs", lambda *_: pytest.fail("was done before"))
    second = run_batch(_settings(folder))
    assert second.again == 2
    assert (folder / "out" / "results.jsonl").read_bytes() == record

    given = ["--category", "mug", "--pose", str(folder / "poses.yaml"), "--estimator", "rigid"]
    given += ["--camera", str(DEMO / "camera.yaml"), "--out", str(folder / "out"), "--json"]
    with pytest.raises(SystemExit) as stopped:
        main(["transfer", str(folder / "pictures"), *given])
    assert stopped.value.code == 1
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines == [json.loads(line) for line in record.splitlines()]


def test_a_picture_is_done_again_once_its_pose_or_a_setting_is_another(folder, without_pages, monkeypatch):
    run_batch(_settings(folder))
    done = []

    def counted(flow, given, one):
        done.append(one.image[0].name)
        raise ImageError("is enough")

    monkeypatch.setattr(batches, "transfer_inputs", counted)
    entries = yaml.safe_load((folder / "poses.yaml").read_text())
    nearer = copy.deepcopy(POSE)
    nearer[2][3] -= 0.01
    entries["b.png"]["camera_from_object"] = nearer
    (folder / "poses.yaml").write_text(yaml.safe_dump(entries))
    run_batch(_settings(folder))
    assert done == ["b.png"]
    run_batch(_settings(folder, seed=1))
    assert done == ["b.png", "a.png", "b.png"]


def test_a_folder_of_poses_gives_each_picture_the_file_of_its_name(folder, without_pages):
    poses = folder / "poses"
    poses.mkdir()
    (poses / "a.yaml").write_text(yaml.safe_dump({"camera_from_object": POSE}))
    found = run_batch(_settings(folder, pose=(poses,)))
    assert found.lines[0]["usable"] > 0
    assert "poses: pose: holds no files of the picture's name (got 'b')" in found.refused[0]


def test_pictures_of_one_stem_have_folders_of_their_own(tmp_path):
    for name in ("a.png", "a.jpg", "b.PNG", "notes.txt"):
        (tmp_path / name).touch()
    assert [name for _, name in pictures_of(tmp_path)] == ["a.jpg", "a.png", "b"]
    with pytest.raises(ImageError, match="holds no picture"):
        pictures_of(DEMO.parent / "instances")


def test_what_is_wrong_with_all_pictures_stops_before_the_first(folder):
    with pytest.raises(SettingsError, match="magic"):
        run_batch(_settings(folder, estimator="magic"))
    assert not (folder / "out").exists()


def test_an_entry_of_a_list_is_found_by_its_picture_and_brings_its_box(tmp_path):
    path = tmp_path / "photos.yaml"
    entry = {"camera_from_object": POSE, "box": [1, 2, 30, 40]}
    path.write_text(yaml.safe_dump([{"image": "in/a.png", **entry}, {"image": "b.png", **entry}]))
    assert read_pose(path, image="b.png").box == (1.0, 2.0, 30.0, 40.0)
    with pytest.raises(PoseError, match=r"holds 2 pictures.*'c\.png'"):
        read_pose(path, image="c.png")
    path.write_text(yaml.safe_dump([{"image": "a.png", **entry, "box": [1, 2]}, {"image": "b.png", **entry}]))
    with pytest.raises(PoseError, match="box: must be"):
        read_pose(path, image="a.png")


def test_one_picture_prints_its_stages_and_as_json_its_result_alone(folder, without_pages, capsys):
    given = ["--category", "mug", "--pose", str(folder / "poses.yaml"), "--estimator", "rigid"]
    given += ["--camera", str(DEMO / "camera.yaml"), "--out", str(folder / "out"), "--json"]
    with pytest.raises(SystemExit) as stopped:
        main(["transfer", str(folder / "pictures" / "a.png"), *given])
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert stopped.value.code is None or stopped.value.code == 0
    assert result["usable"] == sum(grasp["usable"] for grasp in result["grasps"].values()) > 0
    first = [line.split()[0] for line in printed.err.splitlines()]
    assert first == ["reading", "loading", "estimating", "writing"]
