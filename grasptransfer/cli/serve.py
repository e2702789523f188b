"""`grasptransfer serve`: grasp transfer for other processes, Pythons and machines."""

from rich.console import Console

from grasptransfer.errors import SettingsError
from grasptransfer.service.settings import ServiceSettings

console = Console(markup=False)


def serve(settings: ServiceSettings) -> int:
    """Answer requests over ZMQ and msgpack: actions health, metadata and infer; see `service/client.py`."""
    try:
        from grasptransfer.service.server import serve as run
    except ModuleNotFoundError as error:
        raise SettingsError(
            "is not installed", key=str(error.name), fix="pip install 'grasptransfer[serve]'"
        ) from error
    run(settings, on_ready=lambda line: console.print(line, soft_wrap=True))
    return 0
