"""One row for each instance, measured on several processes; a killed run goes on where it stopped."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from grasptransfer import __version__
from grasptransfer.errors import SettingsError
from grasptransfer.files import content_key
from grasptransfer.workshop.benchmark.document import plain

# A row's numbers may differ between their versions.
LIBRARIES = ("numpy", "scipy", "torch", "trimesh", "manifold3d", "coacd", "python-fcl", "numba", "pybullet",
             "mujoco-core", "mujoco")  # fmt: skip

Measure = Callable[[Any, str, str], dict]
Progress = Callable[[int, int], None]


def measure_instances(
    measure: Measure,
    settings: Any,
    found: Sequence[tuple[str, str]],
    *,
    workers: int = 1,
    ledger: Path | None = None,
    progress: Progress | None = None,
) -> list[dict]:
    """Rows of `measure(settings, category, instance)`, in the order of `found`.

    Args:
        measure: a function of a module, so that other processes can import it.
        settings: a dataclass with `categories`.
        found: category and name of each instance.
        workers: processes; 1 measures in this one.
        ledger: JSON lines of finished rows, read first, appended to; rows of other settings do not count.
        progress: is told how many of how many are done.

    Raises:
        SettingsError: no instances, or no workers.
    """
    if workers < 1:
        raise SettingsError("must be at least 1", key="workers", value=workers)
    if not found:
        folder = getattr(settings, "meshes", None)
        raise SettingsError("have no instance", path=folder, key="categories", value=settings.categories)
    key = _digest(measure, settings)
    rows = _read(ledger, key)
    waiting = [names for names in found if names not in rows]
    if progress:
        progress(len(found) - len(waiting), len(found))
    for names, row in _measured(measure, settings, waiting, workers):
        rows[names] = row
        if ledger is not None:
            _append(ledger, key, names, row)
        if progress:
            progress(sum(names in rows for names in found), len(found))
    return [rows[names] for names in found]


def _measured(
    measure: Measure, settings: Any, waiting: Sequence[tuple[str, str]], workers: int
) -> Iterator[tuple[tuple[str, str], dict]]:
    """Each instance with its row, as soon as there is one."""
    if workers == 1 or not waiting:
        for names in waiting:
            yield names, measure(settings, *names)
        return
    context = get_context("spawn")
    count = min(workers, len(waiting))
    with ProcessPoolExecutor(count, context, initializer=_settle, initargs=(workers,)) as pool:
        tasks = {pool.submit(measure, settings, *names): names for names in waiting}
        for task in as_completed(tasks):
            yield tasks[task], task.result()


def _settle(workers: int):
    """Share the cores: libraries that each take all of them wait for one another."""
    import os

    import torch
    from threadpoolctl import threadpool_limits

    threads = max(1, (os.cpu_count() or 1) // workers)
    torch.set_num_threads(threads)
    threadpool_limits(threads)


def _digest(measure: Measure, settings: Any) -> str:
    """Changes with all that a row could change with: settings, categories, gripper, weights and versions.

    A path among the settings, as of a folder of meshes, counts with what it holds.
    """
    from grasptransfer.category import load_category
    from grasptransfer.grasping import load_gripper
    from grasptransfer.simulation.hand import hand_of

    folders = [load_category(name).folder for name in settings.categories]
    name = getattr(settings, "gripper", None)
    gripper = None if name is None else load_gripper(name)
    hand = None if gripper is None else (gripper.path, gripper.urdf_path, hand_of(gripper))
    versions = {library: _version(library) for library in LIBRARIES}
    code = (__version__, versions, measure.__module__, measure.__name__)
    return content_key(code, settings, folders, hand, _weights(settings))


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None


def _weights(settings: Any) -> list[Path]:
    from grasptransfer.category import load_category
    from grasptransfer.perception.weights import find_weights, trained_categories

    told = getattr(settings, "weights", None)
    if told is not None:
        return [told]
    names = set(settings.categories) & set(trained_categories())
    return sorted({find_weights(load_category(name)) for name in names})


def _read(ledger: Path | None, key: str) -> dict[tuple[str, str], dict]:
    """Finished rows; half a last line, of a killed run, is left out."""
    if ledger is None or not ledger.exists():
        return {}
    rows = {}
    for line in ledger.read_text(encoding="utf-8").split("\n"):
        try:
            data = json.loads(line)
        except json.JSONDecodeError:
            continue
        if data["key"] == key:
            rows[data["category"], data["instance"]] = data["row"]
    return rows


def _append(ledger: Path, key: str, names: tuple[str, str], row: dict):
    ledger.parent.mkdir(parents=True, exist_ok=True)
    category, instance = names
    line = json.dumps({"key": key, "category": category, "instance": instance, "row": plain(row)})
    with ledger.open("a", encoding="utf-8") as file:
        file.write("\n" + line + "\n")  # the first break ends half a line of a killed run
