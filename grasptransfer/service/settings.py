"""What a service offers, and to whom."""

from dataclasses import dataclass

from grasptransfer.errors import SettingsError
from grasptransfer.options import Device


@dataclass(frozen=True)
class ServiceSettings:
    """What a service offers, and to whom.

    Args:
        host: address to serve at; 0.0.0.0 lets other machines in, which then need no password.
        port: to serve at.
        categories: names or folders that may be asked for; none given: all shipped ones.
        grippers: names or YAML files that may be asked for, the first by default; none given: all shipped.
        warm: transfers that are kept ready, each of one category, gripper and estimator.
        largest_mb: size of a request, beyond which its sender is disconnected.
    """

    host: str = "127.0.0.1"
    port: int = 5556
    categories: tuple[str, ...] = ()
    grippers: tuple[str, ...] = ()
    device: Device = "auto"
    warm: int = 6
    largest_mb: int = 64

    def __post_init__(self):
        for key, least, most in (("port", 1, 65535), ("warm", 1, 1000), ("largest_mb", 1, 1000)):
            value = getattr(self, key)
            if not least <= value <= most:
                raise SettingsError(f"must lie between {least} and {most}", key=key, value=value)
