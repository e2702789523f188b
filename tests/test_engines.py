"""Two physics engines behind one seam: either does without the other, and what one lacks is said by name."""

import os
import subprocess
import sys

import pytest
from simulated_box import BOX, PANDA, Placed, from_the_side

from grasptransfer.errors import SettingsError
from grasptransfer.simulation import engines, simulate
from grasptransfer.simulation.engines import choose_engine, installed_engines, list_engines

MIDDLE = Placed("middle", from_the_side(), width=0.04)
# A process in which one engine's library does not exist, as where it has no wheels.
WITHOUT = """
import sys, importlib.abc
class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == {missing!r}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing())
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name == {missing!r} else found(name, package)
sys.path.insert(0, "tests")
from simulated_box import BOX, Placed, from_the_side
import grasptransfer as gt
from grasptransfer.errors import SettingsError
(trial,) = gt.simulate([Placed("middle", from_the_side(), width=0.04)], BOX)
print(trial.engine, trial.status.name)
try:
    gt.simulate([Placed("middle", from_the_side(), width=0.04)], BOX, engine={missing!r})
except SettingsError as error:
    print(error)
"""


@pytest.mark.parametrize(("missing", "other"), [("pybullet", "mujoco"), ("mujoco", "pybullet")])
def test_without_one_engine_the_other_is_the_default_and_the_missing_one_is_named(missing, other):
    if other not in installed_engines():
        assert other == "pybullet"
        assert sys.version_info >= (3, 12)
        pytest.skip("PyBullet has no wheels for this Python")
    code = WITHOUT.format(missing=missing)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    ran, refused = done.stdout.splitlines()
    assert ran == f"{other} HELD"
    assert "not installed" in refused
    assert missing in refused
    assert other in refused


def test_an_unknown_engine_is_refused_with_the_known_ones():
    with pytest.raises(SettingsError, match="known: pybullet, mujoco"):
        simulate([MIDDLE], BOX, engine="ode")


def test_without_any_engine_the_error_says_so(monkeypatch):
    monkeypatch.setattr(engines, "find_spec", lambda name: None)
    with pytest.raises(SettingsError, match="no physics engine is installed"):
        choose_engine()


@pytest.mark.parametrize("engine", list_engines())
def test_a_result_names_its_engine_and_a_seed_gives_it_again(engine):
    if engine not in installed_engines():
        pytest.skip(f"{engine} is not installed for this Python")
    first, again = (simulate([MIDDLE], BOX, PANDA, engine=engine, trials=2, seed=4) for _ in range(2))
    assert {trial.engine for trial in first} == {engine}
    assert first == again
    assert first != simulate([MIDDLE], BOX, PANDA, engine=engine, trials=2, seed=5)
    assert simulate([MIDDLE], BOX, PANDA, engine=engine, trials=2, seed=4, workers=2) == first


# A process with a warm world, killed in the middle, and one that ends by itself.
WARM = """
import sys, time
sys.path.insert(0, "tests")
from simulated_box import BOX, Placed, from_the_side
import grasptransfer as gt
gt.simulate([Placed("middle", from_the_side(), width=0.04)], BOX, engine="pybullet")
print("warm", flush=True)
{then}
"""


def test_a_killed_process_leaves_no_temporary_folder_behind(tmp_path):
    if "pybullet" not in installed_engines():
        pytest.skip("MuJoCo writes no files")

    def start(then):
        command = [sys.executable, "-c", WARM.format(then=then)]
        environment = os.environ | {"TMPDIR": str(tmp_path)}
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)

    with start("time.sleep(60)") as killed, start("time.sleep(60)") as other:
        assert [process.stdout.readline() for process in (killed, other)] == ["warm\n"] * 2
        assert len(list(tmp_path.iterdir())) == 2  # that of a process that lives stays
        killed.kill()
        other.kill()
    with start("pass") as last:
        assert last.stdout.readline() == "warm\n"
    assert list(tmp_path.iterdir()) == []
