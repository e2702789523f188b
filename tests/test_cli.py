"""The command line: every help runs, wrong input ends with code 2 and one clear line."""

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml
from PIL import Image

from grasptransfer.category import load_category
from grasptransfer.cli.main import COMMANDS, GROUPS, main
from grasptransfer.cli.progress import progress_bar

EVERY_COMMAND = [[name] for name in COMMANDS] + [[group, name] for group in GROUPS for name in GROUPS[group]]


def _run(arguments: list[str], capsys) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    printed = capsys.readouterr()
    code = stopped.value.code or 0
    assert isinstance(code, int)
    return code, printed.out, printed.err


@pytest.mark.parametrize("command", EVERY_COMMAND, ids=" ".join)
def test_every_command_explains_itself(command, capsys):
    code, out, _ = _run([*command, "--help"], capsys)
    assert code == 0
    assert command[-1] in out


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["category", "info", "teapot"], "mug"),
        (["frames", "claw"], "panda"),
        (["bench", "registration", "--json", "x.json", "--categories", "mug", "--views", "99"], "74"),
        (["convert", "no_such.yaml", "out.npy"], "no_such.yaml"),
        (["train", "teapot"], "mug"),
        (["train", "mug", "--network", "big"], "compact"),
        (["train", "mug", "--loss", "none"], "likelihood"),
        (["train", "mug", "--device", "tpu"], "auto, cpu"),
        (["train", "mug", "--precision", "float16"], "bfloat16"),
        (["train", "mug", "--steps", "0"], "steps"),
        (["train", "mug", "mug"], "twice"),
        (["train", "mug", "--learning-rate", "nan"], "learning_rate"),
        (["train", "mug", "--output", "mug.pt"], ".safetensors"),
        (["bench", "cpd", "--json", "x.json", "--seed", "-1"], "seed"),
        (["annotate", "teapot"], "mug"),
        (["annotate", "mug", "--gripper", "claw"], "panda"),
        (["annotate", "mug", "--port", "99999"], "65535"),
        (["simulate", "--grasps", "none.yaml", "--mesh", "none.obj"], "none.obj"),
        (["category", "build", "x", "--meshes", "none"], "none"),
        (["category", "check", "teapot"], "mug"),
        (["convert", "a.yaml", "out.txt"], ".npy"),
        (["frames", "panda", "--picture", "x.foo"], "png"),
        (["frames", "panda", "--picture", "no_folder/x.png"], "no_folder"),
        (["bench", "cpd", "--json", "x.json", "--sizes", "0"], "at least 10"),
        (["bench", "grasp", "--json", "x.json", "--protocol", "throw"], "lift-shake-v1"),
        (["trasnfer"], "Did you mean transfer?"),
        (["category", "lst"], "Did you mean list?"),
        (["frames", "--pictures", "x"], "Did you mean --picture?"),
        (["category", "info", "spraybottle"], "Did you mean spray_bottle?"),
    ],
)
def test_wrong_input_ends_with_code_2_and_names_the_choices(arguments, word, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = _run(arguments, capsys)
    assert code == 2
    assert word in err
    assert "Traceback" not in out + err
    assert list(tmp_path.iterdir()) == []


def test_a_benchmark_that_could_not_be_written_is_not_run(capsys, tmp_path):
    (tmp_path / "file").touch()
    code, _, err = _run(["bench", "cpd", "--json", str(tmp_path / "file" / "new" / "x.json")], capsys)
    assert code == 2
    assert f"x.json: json: cannot be written. Not into {tmp_path}/file" in err


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Right and wrong files for `transfer`."""
    folder = tmp_path_factory.mktemp("files")
    demo = load_category("mug").folder / "demo"
    pose = np.array(yaml.safe_load((demo / "pose.yaml").read_text())["camera_from_object"])
    turned, placed, unknown = pose.copy(), pose.copy(), pose.copy()
    turned[:3, :3] *= 1.2
    placed[:3, 3] *= 1000
    unknown[0, 3] = np.nan
    poses = {"pose": pose, "scaled": turned, "millimetres": placed, "nan": unknown}
    for name, one in poses.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump({"camera_from_object": one.tolist()}))
    shutil.copy(demo / "camera.yaml", folder)
    shutil.copy(demo / "picture.png", folder)
    picture = Image.open(demo / "picture.png")
    picture.resize((320, 240)).save(folder / "half.png")
    Image.new("L", picture.size).save(folder / "empty_mask.png")
    Image.new("L", (100, 100), 255).save(folder / "small_mask.png")
    (folder / "text.png").write_text("hello")
    (folder / "bad.yaml").write_text("a: [1")
    (folder / "empty.obj").write_text("")
    (folder / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "scene.yaml").write_text("obstacles: {box: {box: [1, 1, 1]}}")
    return folder


WRONG = {  # option of `transfer`: wrong value, what the message must hold
    "image": [("none.png", "none.png: does not exist"), ("text.png", "text.png: cannot be read"),
              ("half.png", "320 x 240")],
    "category": [("teapot", "spray_bottle"), ("bad.yaml", "bad.yaml")],
    "gripper": [("claw", "robotiq_2f85"), ("none.yaml", "none.yaml"), ("bad.yaml", "line")],
    "pose": [("none.yaml", "does not exist"), ("bad.yaml", "line 1"), ("nan.yaml", "NaN"),
             ("scaled.yaml", "scaled or sheared"), ("millimetres.yaml", "Divide")],
    "camera": [("none.yaml", "does not exist"), ("bad.yaml", "line 1"), ("picture.png", "not a text file")],
    "mask": [("empty_mask.png", "is empty"), ("small_mask.png", "(480, 640)"), ("none.png", "none.png")],
    "scene": [("scene.yaml", "camera_from_obstacle"), ("none.yaml", "none.yaml")],
    "execute": [("none.obj", "none.obj"), ("empty.obj", "empty.obj"), ("flat.obj", "flat.obj: is flat"),
                ("pose.yaml", ".glb")],
    "out": [("picture.png", "not a folder")],
    "seed": [("-1", "0 or more")],
    "depth": [("picture.png", "16-bit")],
    "device": [("tpu", "auto, cpu")],
    "precision": [("float16", "bfloat16")],
    "estimator": [("magic", "similarity"), ("cls", "depth")],
}  # fmt: skip
WRONG_VALUES = [(option, value, word) for option, pairs in WRONG.items() for value, word in pairs]


@pytest.mark.parametrize(("option", "value", "word"), WRONG_VALUES, ids=" ".join)
def test_wrong_input_of_a_transfer_is_one_line_that_names_it(
    option, value, word, files, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(files)
    options = {"image": "picture.png", "category": "mug", "pose": "pose.yaml", "camera": "camera.yaml"}
    options |= {"out": str(tmp_path / "out"), "estimator": "rigid"} | {option: value}
    image = options.pop("image")
    flags = [text for name, given in options.items() for text in (f"--{name}", given)]
    code, _, err = _run(["transfer", image, *flags], capsys)
    assert code == 2
    message = [line for line in err.splitlines() if line.startswith("error:")]
    assert len(message) == 1
    assert word in message[0]
    assert err.rstrip().endswith(message[0])  # nothing after it: one paragraph, no traceback
    assert list(tmp_path.iterdir()) == []


def test_grasps_of_another_canonical_model_are_refused(files, capsys, tmp_path, monkeypatch):
    category = load_category("mug")
    shutil.copytree(category.folder, tmp_path / "mug", ignore=shutil.ignore_patterns("demo"))
    path = tmp_path / "mug" / "grasps.yaml"
    path.write_text(path.read_text().replace(category.canonical_sha256, "f" * 64))
    monkeypatch.chdir(files)
    given = ["--category", str(tmp_path / "mug"), "--pose", "pose.yaml", "--out", str(tmp_path / "out")]
    code, _, err = _run(["transfer", "picture.png", *given], capsys)
    assert code == 2
    assert str(path) in err
    assert "canonical" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("told", "word"),
    [
        (["--box", "5", "5", "2", "2"], "(5.0, 5.0, 2.0, 2.0)"),
    ],
)
def test_a_wrong_box_is_explained(told, word, files, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(files)
    given = ["--category", "mug", "--pose", "pose.yaml", "--camera", "camera.yaml", "--estimator", "rigid"]
    code, _, err = _run(["transfer", "picture.png", *given, *told, "--out", str(tmp_path / "out")], capsys)
    assert code == 2
    assert "box" in err
    assert word in err
    assert not (tmp_path / "out").exists()


def test_an_uncertainty_that_is_none_is_explained(files, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(files)
    given = ["--category", "mug", "--pose", "pose.yaml", "--camera", "camera.yaml", "--estimator", "rigid"]
    out = ["--out", str(tmp_path / "out")]
    code, _, err = _run(["transfer", "picture.png", *given, "--pose-sigma", "0.01", *out], capsys)
    assert code == 2
    assert "pose_sigma" in err
    assert not (tmp_path / "out").exists()


def test_a_folder_is_trained_on_and_not_the_shipped_category_of_its_name(tmp_path, capsys, monkeypatch):
    from grasptransfer.workshop.training import train

    class Trained(Exception):
        pass

    def stop(config, *_, **__):
        raise Trained(config)

    monkeypatch.setattr(train, "train", stop)
    folder = tmp_path / "mycup"
    shutil.copytree(load_category("mug").folder, folder)
    with pytest.raises(Trained) as stopped:
        main(["train", str(folder), "bottle", "--run", str(tmp_path / "run")])
    (config,) = stopped.value.args
    assert [category.folder for category in config.categories] == [folder, load_category("bottle").folder]


def test_the_installed_command_runs():
    done = subprocess.run(
        [sys.executable, "-m", "grasptransfer", "--help"], capture_output=True, text=True, check=True
    )
    assert "transfer" in done.stdout


def test_a_package_of_an_extra_that_is_not_installed_is_named_with_its_extra(capsys, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "psutil", None)  # as if it were not installed
    for module in ("workshop.benchmark.cpd", "cli.bench.clouds"):
        monkeypatch.delitem(sys.modules, f"grasptransfer.{module}", raising=False)
    code, _, error = _run(["bench", "cpd", "--sizes", "100", "--json", str(tmp_path / "cpd.json")], capsys)
    assert code == 2
    assert "needs the package psutil. pip install 'grasptransfer[workshop]'" in " ".join(error.split())


def test_the_version_is_printed_with_that_of_python(capsys):
    code, out, _ = _run(["--version"], capsys)
    assert code == 0
    assert re.fullmatch(r"grasptransfer \d+\.\d+\.\d+, Python 3\.\d+\.\d+, \w+\n", out)


def test_lists_are_printed_as_json(capsys):
    _, out, _ = _run(["category", "list", "--json"], capsys)
    assert "mug" in json.loads(out)
    _, out, _ = _run(["category", "info", "mug", "--json"], capsys)
    assert json.loads(out)["name"] == "mug"
    _, out, _ = _run(["category", "check", "mug", "--json"], capsys)
    assert json.loads(out) == []


def test_shells_complete_commands_of_groups_and_their_options(capsys):
    command = [sys.executable, "-m", "grasptransfer", "--print-completion", "bash"]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for word in ("transfer", "pose-noise", "--category", "--control-points"):
        assert word in out
    code, _, err = _run(["--print-completion", "bas"], capsys)
    assert code == 2
    assert "Did you mean bash?" in err


def test_long_work_prints_plain_lines_where_nobody_watches(capsys):
    with progress_bar() as progress:
        task = progress.add_task("training")
        for done in range(101):
            progress.update(task, description=f"training  {done} samples/s", completed=done, total=100)
        progress.update(task, description="fitting", completed=0, total=2)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 12
    assert lines[0] == "training  0 samples/s 0/100"
    assert lines[-1] == "fitting 0/2"


def test_who_reads_only_the_first_lines_gets_no_traceback():
    command = f"{sys.executable} -m grasptransfer category info mug --json | head -n 1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert done.stdout == "{\n"
    assert done.stderr == ""
