"""`grasptransfer serve`: grasp transfer for other processes, Pythons and machines."""

from rich.console import Console

console = Console(markup=False)


def serve(
    *,
    host: str = "127.0.0.1",
    port: int = 5556,
    categories: tuple[str, ...] = (),
    grippers: tuple[str, ...] = (),
    device: str = "auto",
    largest_mb: int = 64,
) -> int:
    """Answer requests over ZMQ and msgpack: actions health, metadata and infer; see `service/client.py`.

    Args:
        host: address to serve at; 0.0.0.0 lets other machines in: nothing asks them for a password.
        port: to serve at.
        categories: names or folders that may be asked for; none given: all shipped ones.
        grippers: names or YAML files that may be asked for, the first by default; none given: all shipped.
        device: auto, cpu or cuda.
        largest_mb: size of a request, beyond which its sender is disconnected [MB].
    """
    from grasptransfer.errors import SettingsError

    try:
        from grasptransfer.service.server import ServiceSettings
        from grasptransfer.service.server import serve as run
    except ModuleNotFoundError as error:
        raise SettingsError(
            "is not installed", key=str(error.name), fix="pip install 'grasptransfer[serve]'"
        ) from error
    settings = ServiceSettings(host, port, categories, grippers, device, largest_mb=largest_mb)
    run(settings, on_ready=lambda line: console.print(line, soft_wrap=True))
    return 0
