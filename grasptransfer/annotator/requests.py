"""What people ask for in the browser, kept until the page's own thread does it."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Request:
    """One thing that a person asked for.

    Args:
        action: what to do.
        grasp: for which it was asked, so that it is left undone once another is chosen; None: for any.
        drag: whether it is a move of the gripper, which a later one replaces.
    """

    action: Callable[[], Any]
    grasp: str | None
    drag: bool


class Requests:
    """Requests in their order; viser's threads add them, the page takes them."""

    def __init__(self):
        self._pending: list[Request] = []
        self._lock = threading.Lock()

    def add(self, request: Request) -> None:
        """Put a request at the end; of many small moves in a row only the last one stays."""
        with self._lock:
            if request.drag and self._pending and self._pending[-1].drag:
                self._pending.pop()
            self._pending.append(request)

    def taken(self) -> list[Request]:
        """All requests so far; they are gone then."""
        with self._lock:
            taken, self._pending = self._pending, []
        return taken
