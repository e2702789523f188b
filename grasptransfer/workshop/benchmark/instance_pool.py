"""One row for each instance, measured on several processes; a killed run goes on where it stopped."""

from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from grasptransfer import __version__
from grasptransfer.errors import SettingsError
from grasptransfer.files import content_key
from grasptransfer.jobs import Record, run
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
        progress: called with (instances done, in all).

    Raises:
        SettingsError: no instances, or no workers.
    """
    if workers < 1:
        raise SettingsError("must be at least 1", key="workers", value=workers)
    if not found:
        folder = getattr(settings, "meshes", None)
        raise SettingsError("have no instance", path=folder, key="categories", value=settings.categories)
    key = _digest(measure, settings)
    with Record(ledger) as record:
        rows = _rows(record, key)
        waiting = [names for names in found if names not in rows]
        if progress:
            progress(len(found) - len(waiting), len(found))
        others = workers if workers > 1 else 0
        for ended in run(measure, waiting, workers=others, shared=(settings,)):
            names = waiting[ended.index]
            rows[names] = ended.result()
            record.add(_line(key, names, rows[names]))
            if progress:
                progress(sum(names in rows for names in found), len(found))
    return [rows[names] for names in found]


def _digest(measure: Measure, settings: Any) -> str:
    """A digest of all that decides a row: settings, categories, gripper, weights and versions.

    A path among the settings, such as a folder of meshes, counts by its content.
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
    """Files of trained and fitted numbers that a row depends on."""
    from grasptransfer.category import load_category
    from grasptransfer.grasping.experience import experience_path
    from grasptransfer.grasping.success_model import ranking_path
    from grasptransfer.perception.pose_search.chances import chances_path
    from grasptransfer.perception.weights import find_weights, trained_categories

    given = getattr(settings, "weights", None)
    if given is not None:
        return [given]
    names = set(settings.categories) & set(trained_categories())
    found = {find_weights(load_category(name)) for name in names}
    fitted = {ranking_path(), experience_path(), chances_path()}
    return sorted(found | {path.with_suffix(".yaml") for path in found} | fitted)


def _line(key: str, names: tuple[str, str], row: dict) -> dict:
    category, instance = names
    return {"key": key, "category": category, "instance": instance, "row": plain(row)}


def _rows(record: Record, key: str) -> dict[tuple[str, str], dict]:
    """Finished rows of the same settings.

    Raises:
        SettingsError: the file is no record of a benchmark.
    """
    rows = {}
    for line in record.lines():
        if not {"key", "category", "instance", "row"} <= set(line):
            raise SettingsError("holds no rows of a benchmark", path=record.path, value=sorted(line))
        if line["key"] == key:
            rows[line["category"], line["instance"]] = line["row"]
    return rows
