"""How long commands say what they do: a bar in a terminal, plain lines where the output goes elsewhere."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

PARTS = 10  # plain lines of one step


class PlainProgress:
    """What `rich.progress.Progress` shows, as lines for files and pipes: each step, and its tenths."""

    def __init__(self, console: Console):
        self.console = console
        self._tasks: list[_Task] = []

    def __enter__(self) -> "PlainProgress":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def add_task(self, description: str, total: float | None = None, visible: bool = True) -> TaskID:
        """A step that is to come; its first line is printed once it is at work."""
        self._tasks.append(_Task(description, total))
        return TaskID(len(self._tasks) - 1)

    def update(
        self,
        task: TaskID,
        *,
        description: str | None = None,
        completed: float | None = None,
        total: float | None = None,
        visible: bool = True,
    ) -> None:
        """Print a line where the step is another than before, or a tenth of it more is done."""
        state = self._tasks[task]
        state.total = state.total if total is None else total
        if description is not None:
            if state.step != _step(description):
                state.printed = None
            state.description = description
        share = 0.0 if not state.total or completed is None else completed / state.total
        if state.printed is None or int(PARTS * share) > state.printed:
            state.printed = int(PARTS * share)
            done = f" {completed:g}/{state.total:g}" if state.total and completed is not None else ""
            self.console.print(f"{state.description}{done}", soft_wrap=True, highlight=False)


@dataclass
class _Task:
    description: str
    total: float | None
    printed: int | None = None  # tenths of the last line

    @property
    def step(self) -> str:
        return _step(self.description)


def _step(description: str) -> str:
    """The description without the figures that follow it."""
    return description.split("  ")[0]


def progress_bar() -> Progress | PlainProgress:
    """Shows the step at work, how much of it is done and how long it will take, on standard error."""
    console = Console(stderr=True, markup=False)
    if not console.is_terminal:
        return PlainProgress(console)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console)


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """A function to call with one line on what is done next; shown on standard error."""
    console = Console(stderr=True, markup=False)
    if not console.is_terminal:
        yield lambda line: console.print(line, soft_wrap=True, highlight=False)
        return
    with console.status("") as status:
        yield lambda line: status.update(line)


def duration(seconds: float) -> str:
    """A rough duration in the unit that fits."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
