"""Serving the page of a pose until it is left."""

import threading
from collections.abc import Callable
from pathlib import Path

from grasptransfer.page_server import REFRESH, page_server
from grasptransfer.posing.page import PosePage
from grasptransfer.posing.session import PoseSession


def pose_in_browser(
    session: PoseSession,
    path: Path,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    on_ready: Callable[[str], None] = lambda text: None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the page until interrupted, or until `stop` is set.

    Args:
        session: that it shows.
        path: pose file that `save` writes.
        host, port: to serve at.
        on_ready: is called with one line that says where the page is, and with one at the end.

    Raises:
        GraspTransferError: a wrong port; viser is not installed.
    """
    stop = stop or threading.Event()
    page = None
    with page_server(f"pose of a {session.category.name}", host=host, port=port) as server:
        try:
            page = PosePage(server, session, path)
            on_ready(f"Drag, fit, save: http://{host}:{server.get_port()}  (Ctrl-C ends)")
            while not stop.wait(REFRESH):
                page.refresh()
        except KeyboardInterrupt:
            on_ready(f"saved to {path}" if page is not None and page.saved else "the pose was not saved")
