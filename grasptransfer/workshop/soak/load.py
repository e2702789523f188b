"""Many transfers one after the other, in threads and in processes: memory stays, and so do the answers."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
import psutil
from rich.table import Table

from grasptransfer.camera import Camera
from grasptransfer.category import load_category
from grasptransfer.errors import SettingsError
from grasptransfer.jobs import run as run_pieces
from grasptransfer.perception.observation import read_image
from grasptransfer.poses import load_pose
from grasptransfer.transfer import GraspTransfer

WARM = 20  # transfers before anything is measured: libraries take their memory with the first ones
MOST_GROWTH = 0.05  # of memory, and of time
THREADS, PROCESSES = 8, 4


@dataclass(frozen=True)
class LoadSettings:
    """How much is done.

    Args:
        transfers: of the run in one process; the others do a tenth of them.
        estimator: what is transferred by.
    """

    transfers: int = 10_000
    estimator: str = "rgb"

    def __post_init__(self):
        if self.transfers < 100:
            raise SettingsError("must be at least 100", key="transfers", value=self.transfers)


@dataclass(frozen=True)
class LoadRow:
    """What one way of running did.

    Args:
        run: what ran.
        transfers: in all.
        different: answers that were not those of the first transfer.
        per_second: transfers.
        memory_mb: of the process, or the largest of them, at the end.
        memory_growth: median of the last tenth over that of the second tenth, less 1; 0 where not measured.
        slow_down: of the median time of a transfer, likewise.
    """

    run: str
    transfers: int
    different: int
    per_second: float
    memory_mb: float
    memory_growth: float = 0.0
    slow_down: float = 0.0

    @property
    def is_bad(self) -> bool:
        """Whether memory grew, or an answer differed. Time is only told: others may use the machine."""
        return self.different > 0 or self.memory_growth > MOST_GROWTH


def run_load(settings: LoadSettings, *, progress: Callable[[str], None] = lambda name: None) -> list[LoadRow]:
    """Run all ways, one after the other.

    Args:
        progress: called with the name of each before it begins.
    """
    fewer, how = settings.transfers // 10, settings.estimator
    ways: list[tuple[str, Callable[[], LoadRow]]] = [
        ("one process", lambda: _one_after_the_other(settings.transfers, how)),
        (
            f"{THREADS} threads, one GraspTransfer",
            lambda: _in_threads(fewer, how, shared=True),
        ),
        (f"{THREADS} threads, one each", lambda: _in_threads(fewer, how, shared=False)),
        (f"{PROCESSES} processes", lambda: _in_processes(fewer, how)),
    ]
    rows = []
    for name, way in ways:
        progress(name)
        rows.append(way())
    return rows


def load_table(rows: Sequence[LoadRow]) -> tuple[Table, int]:
    """A row for each way of running; and how many are bad."""
    table = Table(
        "run", "transfers", "other answers", "per second", "memory [MB]", "memory grew", "slower by"
    )
    for row in rows:
        one = row.run.startswith("one")
        growth = (f"{row.memory_growth:+.1%}", f"{row.slow_down:+.1%}") if one else ("", "")
        numbers = (str(row.transfers), str(row.different), f"{row.per_second:.2f}", f"{row.memory_mb:.0f}")
        table.add_row(row.run, *numbers, *growth)
    return table, sum(row.is_bad for row in rows)


@cache
def _demo() -> tuple[np.ndarray, np.ndarray, Camera]:
    folder = load_category("mug").folder / "demo"
    pixels = read_image(folder / "picture.png")
    return pixels, load_pose(folder / "pose.yaml"), Camera.load(folder / "camera.yaml")


def _answer(flow: GraspTransfer) -> tuple:
    """What must be the same each time, to a thousandth of a millimetre and of a score."""
    pixels, pose, camera = _demo()
    result = flow.transfer(pixels, pose, camera=camera, box=(284, 183, 404, 340))
    places = [(g.name, g.status.value, *np.round(g.camera_from_gripper[:3, 3], 5)) for g in result.grasps]
    return tuple(places)


def _memory() -> float:
    return psutil.Process().memory_info().rss / 1e6


def _one_after_the_other(count: int, estimator: str) -> LoadRow:
    flow = GraspTransfer("mug", estimator=estimator)
    first = _answer(flow)
    for _ in range(WARM):
        _answer(flow)
    memory, seconds, different = np.zeros(count), np.zeros(count), 0
    for number in range(count):
        start = time.perf_counter()
        different += _answer(flow) != first
        seconds[number], memory[number] = time.perf_counter() - start, _memory()
    tenth = count // 10
    early, late = slice(tenth, 2 * tenth), slice(count - tenth, count)
    growth, slow = (float(np.median(v[late]) / np.median(v[early]) - 1) for v in (memory, seconds))
    return LoadRow("one process", count, different, count / seconds.sum(), memory[-1], growth, slow)


def _in_threads(count: int, estimator: str, *, shared: bool) -> LoadRow:
    flows = [GraspTransfer("mug", estimator=estimator) for _ in range(1 if shared else THREADS)]
    first = _answer(flows[0])
    start = time.perf_counter()
    with ThreadPoolExecutor(THREADS) as pool:
        answers = list(pool.map(lambda number: _answer(flows[number % len(flows)]), range(count)))
    seconds = time.perf_counter() - start
    name = f"{THREADS} threads, {'one GraspTransfer' if shared else 'one each'}"
    return LoadRow(name, count, sum(answer != first for answer in answers), count / seconds, _memory())


def _in_processes(count: int, estimator: str) -> LoadRow:
    first = _answer(GraspTransfer("mug", estimator=estimator))
    each = max(count // PROCESSES, 1)
    start = time.perf_counter()
    pieces = [(estimator, each)] * PROCESSES
    ended = [one.result() for one in run_pieces(_answers, pieces, workers=PROCESSES)]
    seconds = time.perf_counter() - start
    different = sum(answer != first for answers, _ in ended for answer in answers)
    memory = max(memory for _, memory in ended)
    return LoadRow(f"{PROCESSES} processes", each * PROCESSES, different, each * PROCESSES / seconds, memory)


def _answers(estimator: str, count: int) -> tuple[list[tuple], float]:
    flow = GraspTransfer("mug", estimator=estimator)
    return [_answer(flow) for _ in range(count)], _memory()
