"""A page in the browser, served by viser."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from grasptransfer.errors import SettingsError

if TYPE_CHECKING:
    import viser

REFRESH = 0.05  # s between updates of a page


@contextlib.contextmanager
def page_server(label: str, *, host: str, port: int) -> Iterator[viser.ViserServer]:
    """A server of one page, which stops when the block ends.

    Args:
        label: title of the page.

    Raises:
        SettingsError: a wrong port; viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise SettingsError("the package viser is missing", fix="pip install viser") from error
    if not 0 < port < 65536:
        raise SettingsError("must lie between 1 and 65535", key="port", value=port)
    server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    try:
        yield server
    finally:
        server.stop()
