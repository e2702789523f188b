"""A build that is killed, at any moment, resumes and gives the same bytes."""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from vases import build_vases, write_vases

from grasptransfer.errors import CategoryError

# Killed as a machine would: no clean-up of its own. `write` is killed with the older folder in its hands.
KILLED = """
import os, signal, sys
from grasptransfer.workshop.building import writing
from vases import build_vases

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def between(staging, folder, replaced):
    os.replace(folder, replaced)
    die()

if __name__ == "__main__":
    meshes, out, step = sys.argv[1:]
    if step == "write":
        writing._put_in_place = between
    progress = lambda state: die() if state.step == step == "register" and state.done == 2 else None
    given = {"finish": die} if step == "page" else {"progress": progress, "overwrite": True}
    build_vases(meshes, out, **given)
"""


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    return write_vases(tmp_path_factory.mktemp("vases"))


@dataclass(frozen=True)
class Undisturbed:
    """A build that nothing killed: its folder, and the results it kept until its end."""

    folder: Path
    results: Path


@pytest.fixture(scope="module")
def undisturbed(meshes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    kept, results = folder / ".vase.build", folder / "results"
    built = build_vases(meshes, folder / "vase", finish=lambda _: shutil.copytree(kept, results))
    return Undisturbed(built.category.folder, results)


@pytest.fixture
def nearly_built(undisturbed, tmp_path):
    """Where a category is to be written all of whose results are there: a build goes on with writing."""
    (tmp_path / "out").mkdir()
    shutil.copytree(undisturbed.results, tmp_path / "out" / ".vase.build")
    return tmp_path / "out" / "vase"


def run_until_killed(meshes: Path, out: Path, step: str) -> None:
    script = out.parent.parent / f"{step}.py"
    script.write_text(KILLED)
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, str(script), str(meshes), str(out), step]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_build_killed_half_way_resumes_and_gives_the_same_bytes(meshes, undisturbed, tmp_path):
    out = tmp_path / "out" / "vase"
    out.parent.mkdir()
    run_until_killed(meshes, out, "register")
    assert not out.exists()
    seen = []
    build_vases(meshes, out, progress=seen.append)
    first = {step: next(one for one in seen if one.step == step) for step in ("check", "register")}
    assert first["check"].done == 5
    assert first["register"].done >= 2
    assert contents(out) == contents(undisturbed.folder)
    assert [path.name for path in out.parent.iterdir()] == ["vase"]


def test_a_build_killed_while_it_replaces_a_category_loses_neither(meshes, undisturbed, nearly_built):
    out = nearly_built
    out.mkdir()
    (out / "grasps.yaml").write_text("grasps: mine\n")
    run_until_killed(meshes, out, "write")
    assert not out.exists()
    build_vases(meshes, out)
    assert contents(out) == {**contents(undisturbed.folder), "grasps.yaml": b"grasps: mine\n"}
    assert [path.name for path in out.parent.iterdir()] == ["vase"]


def test_a_build_killed_while_its_page_is_drawn_can_be_finished(meshes, undisturbed, nearly_built):
    out = nearly_built
    run_until_killed(meshes, out, "page")
    assert contents(out) == contents(undisturbed.folder)
    with pytest.raises(CategoryError, match="exists already"):
        build_vases(meshes, out, scale=0.5)  # another category than the one that stands there
    drawn = []
    build_vases(meshes, out, finish=drawn.append)
    assert len(drawn) == 1
    assert contents(out) == contents(undisturbed.folder)
    assert [path.name for path in out.parent.iterdir()] == ["vase"]
