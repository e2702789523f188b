"""The annotator's page: the canonical model, a gripper to drag, and live checks, served by viser."""

import threading
from collections.abc import Callable
from pathlib import Path

from grasptransfer.annotator.page import Page
from grasptransfer.annotator.session import Session
from grasptransfer.category import Category, load_category
from grasptransfer.grasping import Gripper, load_gripper
from grasptransfer.page_server import REFRESH, page_server


def annotate(
    category: str | Path | Category,
    *,
    gripper: str | Path | Gripper = "panda",
    path: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    on_ready: Callable[[str], None] = lambda text: None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the annotator until interrupted, or until `stop` is set.

    Args:
        category: name, folder or loaded `Category`.
        gripper: name, YAML path or loaded `Gripper`.
        path: grasp file; None takes the one of `document.own_path`.
        host, port: to serve at.
        on_ready: is called with one line that says where the page is.

    Raises:
        GraspTransferError: wrong category, gripper or grasp file; viser is not installed.
    """
    loaded = gripper if isinstance(gripper, Gripper) else load_gripper(gripper)
    session = Session(load_category(category), loaded, path=path)
    stop = stop or threading.Event()
    with page_server(f"grasps of {session.category.name}", host=host, port=port) as server:
        try:
            page = Page(server, session)
            on_ready(f"Annotating {session.path}: http://{host}:{server.get_port()}  (Ctrl-C ends)")
            while not stop.wait(REFRESH):
                page.refresh()
        except KeyboardInterrupt:
            on_ready("unsaved changes are lost" if session.unsaved else "everything is saved")
