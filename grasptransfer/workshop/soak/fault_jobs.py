"""Commands that are killed at random moments: their inputs, and what must come out of them all the same."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

GRASPTRANSFER = (sys.executable, "-m", "grasptransfer")
# What an annotator does who saves after every edit.
SAVING = """
import sys
from dataclasses import replace
from pathlib import Path
from grasptransfer.annotator.session import Session
from grasptransfer.category import load_category
from grasptransfer.grasping import load_gripper

session = Session(load_category("mug"), load_gripper("panda"), path=Path(sys.argv[1]))
name = session.names[0]
for number in range(12):
    session.describe(name, label=f"edit {number}")
    session.save(refused=True)
"""


@dataclass(frozen=True)
class FaultJob:
    """One command.

    Args:
        name: for the table.
        make: writes its inputs into a folder.
        command: the command, given the folder with the inputs; what it writes goes to `out` below it.
        result: what must be the same as of an undisturbed run, given the folder.
        has_workers: whether it starts processes of its own.
    """

    name: str
    make: Callable[[Path], None]
    command: Callable[[Path], list[str]]
    result: Callable[[Path], Any]
    has_workers: bool = True


def fault_jobs() -> tuple[FaultJob, ...]:
    """All of them, in the order of the table."""
    return (
        FaultJob("annotator, save", _grasps, _saving, _saved, has_workers=False),
        FaultJob("category build", _vases, _build, _built),
        FaultJob("transfer FOLDER", _pictures, _transfer, _transferred, has_workers=False),
        FaultJob("simulate --results", _nothing, _simulate, _trials),
        FaultJob("bench registration", _nothing, _bench("registration", "--views", "1", *SIMPLE), _document),
        FaultJob("bench pose-noise", _nothing, _bench("pose-noise", "--views", "1", *SIMPLE), _document),
        FaultJob("bench grasp", _nothing, _bench("grasp", "--views", "1", *SIMPLE), _document),
        FaultJob("bench engines", _nothing, _bench("engines"), _document),
        FaultJob("bench calibration", _nothing, _bench("calibration", "--objects", "3"), _document),
        FaultJob("train (pictures, network, confidence)", _nothing, _train, _weights),
    )


SIMPLE = ("--estimators", "rigid", "similarity")
HOW_VASES = "--control-points 80 --beta 1 --lam 1 --modes 2 --flexibility 0 --workers 2"
SKIPPED = ("seconds", "machine", "settings", "version")  # of documents: these differ from run to run


def _nothing(folder: Path) -> None:
    pass


def _grasps(folder: Path) -> None:
    from grasptransfer.category import load_category

    shutil.copy(load_category("mug").grasps_path, folder)


def _saving(folder: Path) -> list[str]:
    return [sys.executable, "-c", SAVING, str(folder / "grasps.yaml")]


def _saved(folder: Path) -> bytes:
    return (folder / "grasps.yaml").read_bytes()


def _vases(folder: Path) -> None:
    for number in range(5):
        height, width = 0.10 + 0.01 * number, 0.050 + 0.002 * number
        profile = np.array([[0, 0], [0.6, 0], [1, 0.4], [0.5, 0.9], [0.5, 1], [0, 1]]) * [width / 2, height]
        flag = trimesh.creation.box((0.6 * width, 0.2 * width, 0.2 * height))
        flag.apply_translation([0.7 * width, 0, 0.5 * height])
        (folder / "meshes").mkdir(exist_ok=True)
        both = trimesh.creation.revolve(profile, sections=24) + flag
        both.export(folder / "meshes" / f"vase_{number}.obj")


def _build(folder: Path) -> list[str]:
    how = [
        "--control-points",
        "80",
        "--beta",
        "1",
        "--lam",
        "1",
        "--modes",
        "2",
        "--flexibility",
        "0",
        "--workers",
        "2",
    ]
    places = ["--meshes", str(folder / "meshes"), "--out", str(folder / "out" / "vase")]
    return [*GRASPTRANSFER, "category", "build", "vase", *places, *how]


def _built(folder: Path) -> dict[str, bytes]:
    # The page says how long it took.
    return {name: data for name, data in _bytes_below(folder / "out").items() if not name.endswith(".html")}


def _pictures(folder: Path) -> None:
    from grasptransfer.category import load_category
    from grasptransfer.poses import load_pose, pose_as_yaml

    demo = load_category("mug").folder / "demo"
    (folder / "pictures").mkdir()
    pose = pose_as_yaml(load_pose(demo / "pose.yaml"))
    for name in "abcd":
        shutil.copy(demo / "picture.png", folder / "pictures" / f"{name}.png")
    (folder / "poses.yaml").write_text(yaml.safe_dump({f"{name}.png": pose for name in "abcd"}))
    shutil.copy(demo / "camera.yaml", folder)


def _transfer(folder: Path) -> list[str]:
    files = ["--pose", str(folder / "poses.yaml"), "--camera", str(folder / "camera.yaml")]
    given = ["--category", "mug", "--estimator", "rigid", "--out", str(folder / "out")]
    return [*GRASPTRANSFER, "transfer", str(folder / "pictures"), *files, *given]


def _transferred(folder: Path) -> dict[str, Any]:
    files = _bytes_below(folder / "out")
    kept = {name: data for name, data in files.items() if name.endswith(("grasps.yaml", ".glb", "field.npz"))}
    lines = [json.loads(line) for line in (folder / "out" / "results.jsonl").read_text().splitlines()]
    return kept | {"lines": [(line["image"], line["usable"], line["best"]) for line in lines]}


def _simulate(folder: Path) -> list[str]:
    from grasptransfer.category import load_category

    mug = load_category("mug").folder
    files = ["--grasps", str(mug / "grasps.yaml"), "--mesh", str(mug / "canonical.glb")]
    record = ["--results", str(folder / "trials.jsonl")]
    return [*GRASPTRANSFER, "simulate", *files, *record, "--trials", "4", "--workers", "2"]


def _trials(folder: Path) -> list[str]:
    lines = [json.loads(line) for line in (folder / "trials.jsonl").read_text().splitlines()]
    return sorted(json.dumps(_without_times(line), sort_keys=True) for line in lines)


def _bench(name: str, *options: str) -> Callable[[Path], list[str]]:
    def command(folder: Path) -> list[str]:
        given = ["--categories", "mug", "--workers", "2", "--json", str(folder / "out.json")]
        return [*GRASPTRANSFER, "bench", name, *given, *options]

    return command


def _document(folder: Path) -> Any:
    return _without_times(json.loads((folder / "out.json").read_text()))


def _train(folder: Path) -> list[str]:
    how = ["--samples", "128", "--held-out", "32", "--steps", "6", "--members", "1", "--batch", "8"]
    places = ["--run", str(folder / "run"), "--output", str(folder / "out" / "mug.safetensors")]
    return [*GRASPTRANSFER, "train", "mug", *how, *places]


def _weights(folder: Path) -> dict[str, bytes]:
    # The card says how long it took.
    return {name: data for name, data in _bytes_below(folder / "out").items() if not name.endswith(".md")}


def _bytes_below(folder: Path) -> dict[str, bytes]:
    """Every file, those of unfinished work too: what is left half-written would differ."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(inner) for key, inner in value.items() if not key.startswith(SKIPPED)}
    return [_without_times(inner) for inner in value] if isinstance(value, list) else value
