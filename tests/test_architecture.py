"""A room imports only from rooms above it, and importing the package stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "grasptransfer"
# The product's rooms from the ground up, then the workshop's, then the commands of both.
ROOMS = [
    {"errors"},
    {"files"},
    {"data_files", "page_server"},
    {"frames"},
    {"yaml_models", "picture_entries", "exif"},
    {"fitted"},
    {"camera_files"},
    {"camera"},
    {"pose_formats"},
    {"poses"},
    {"given"},
    {"meshes"},
    {"solids"},
    {"drawing"},
    {"jobs"},
    {"registration"},
    {"category"},
    {"perception"},
    {"grasping"},
    {"category_check"},
    {"simulation"},
    {"waypoints"},
    {"result"},
    {"choice", "pairs"},
    {"track"},
    {"transfer"},
    {"options"},
    {"report", "annotator"},
    {"posing"},
    {"service"},
    {"workshop"},
    {"workshop.objects"},
    {"workshop.building"},
    {"workshop.training"},
    {
        "workshop.benchmark",
        "workshop.demo_picture",
        "workshop.figures",
        "workshop.soak",
        "workshop.frame_drawings",
    },
    {"cli", "__init__", "__main__"},
]
LEVEL = {room: level for level, rooms in enumerate(ROOMS) for room in rooms}
# A result knows how to write itself; the report room is loaded when it does. `given` only names types.
EXCEPTIONS = {("result", "report"), ("given", "grasping")}
MODULES = sorted(PACKAGE.rglob("*.py"))


def _room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    inner = parts[0] == "workshop" and parts[1] != "__init__"
    return ".".join(parts[: 1 + inner])


def _room_of_module(name: str) -> str:
    parts = name.split(".")[1:]
    return ".".join(parts[: 1 + (parts[0] == "workshop")])


def _imported_rooms(path: Path) -> set[str]:
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names = [node.module or ""]
            if node.module in ("grasptransfer", "grasptransfer.workshop"):
                names = [f"{node.module}.{alias.name}" for alias in node.names if alias.name != "__version__"]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        rooms |= {_room_of_module(name) for name in names if name.startswith("grasptransfer.")}
    return rooms


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_room_imports_only_from_rooms_above_it(path):
    room = _room(path)
    assert room in LEVEL, f"{path} lies in no known room"
    if room in ("__init__", "cli", "__main__"):
        return
    below = {name for name in _imported_rooms(path) - {room} if LEVEL[name] >= LEVEL[room]}
    below = {name for name in below if (room, name) not in EXCEPTIONS}
    beside = {name for name in below if LEVEL[name] == LEVEL[room]}
    assert below - beside == set(), f"{room} imports from {below - beside}"


def test_commands_import_the_workshop_only_when_one_of_them_runs():
    code = "import sys, grasptransfer.cli; print([m for m in sys.modules if 'grasptransfer.workshop.' in m])"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert output.stdout.strip() == "[]"


def test_importing_the_package_loads_no_heavy_library():
    heavy = ["torch", "pybullet", "mujoco", "pyrender", "fcl", "viser", "matplotlib", "numba", "pyglet"]
    code = f"import sys, grasptransfer; print([m for m in {heavy} if m in sys.modules])"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert output.stdout.strip() == "[]"


def test_an_estimator_runs_without_what_trains_its_network():
    code = (
        "import sys, grasptransfer.perception.rgb; print([m for m in sys.modules if m.startswith('grasp')])"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "grasptransfer.perception.weights" in output
    assert "grasptransfer.workshop" not in output


def test_no_module_is_named_after_nothing():
    names = {path.stem for path in MODULES}
    assert not names & {"utils", "util", "common", "helpers", "misc"}


TREES = {path: ast.parse(path.read_text()) for path in MODULES}
# Calls that other people's code relies on; this list may only grow shorter.
MANY_PARAMETERS = {
    "registration/cpd.py:cpd",
    "simulation/execution.py:simulate",
    "transfer.py:transfer",
    "transfer.py:transfer_grasps",
}


def _functions():
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                yield f"{path.relative_to(PACKAGE).as_posix()}:{node.name}", node


def _code_lines(node: ast.FunctionDef) -> int:
    """Lines from `def` to the end, without the docstring."""
    first = node.body[0]
    text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    docstring = (first.end_lineno or 0) - first.lineno + 1 if text else 0
    return (node.end_lineno or 0) - node.lineno + 1 - docstring


def _parameters(node: ast.FunctionDef) -> int:
    given = node.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def test_no_file_is_longer_than_300_lines():
    assert [path for path in MODULES if path.read_text().count("\n") > 300] == []


def test_no_function_takes_more_than_eight_parameters():
    assert {name for name, node in _functions() if _parameters(node) > 8} - MANY_PARAMETERS == set()


def test_no_function_has_more_than_40_lines_of_code():
    assert {name for name, node in _functions() if _code_lines(node) > 40} == set()


def test_public_class_names_are_unique():
    names = [
        node.name
        for tree in TREES.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    assert {name for name in names if names.count(name) > 1} == set()


def test_every_room_says_what_it_is_for():
    silent = [path for path in MODULES if path.name == "__init__.py" and not ast.get_docstring(TREES[path])]
    assert silent == []
