"""All commands of `grasptransfer …`, and how they end.

Exit codes: 0 done; 1 ran, and found no usable grasp or missed a bar; 2 wrong input.
"""

import errno
import logging
import os
import platform
import re
import sys
from importlib.metadata import requires

from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape

from grasptransfer import __version__
from grasptransfer.cli.parsing import Table, parsed
from grasptransfer.errors import GraspTransferError

# Disks that are full or read-only, where a library writes what it has compiled, say.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
# Each command as `module:function` of `grasptransfer.cli`; modules are imported when they are needed.
GROUPS: dict[str, Table] = {
    "category": {
        "list": "category:list_",
        "info": "category:info",
        "check": "category:check",
        "build": "build:build",
    },
    "bench": {
        "cpd": "bench.clouds:cpd",
        "latent-fit": "bench.clouds:latent_fit",
        "registration": "bench.pictures:registration",
        "pose-noise": "bench.pictures:pose_noise",
        "glass": "bench.pictures:glass",
        "latency": "bench.pictures:latency",
        "photos": "bench.pictures:photos",
        "pose": "bench.pictures:pose",
        "refusal": "bench.pictures:refusal",
        "grasp": "bench.grasps:grasp",
        "calibration": "bench.grasps:calibration",
        "engines": "bench.grasps:engines",
    },
}
COMMANDS: Table = {
    "demo": "transfer:demo",
    "examples": "examples:examples",
    "transfer": "transfer:transfer",
    "category": "category",
    "train": "train:train",
    "annotate": "annotate:annotate",
    "pose": "pose:pose",
    "board": "pose:board",
    "simulate": "transfer:simulate",
    "serve": "serve:serve",
    "mcp": "mcp:mcp",
    "convert": "grasps:convert",
    "frames": "grasps:frames",
    "bench": "bench",
}


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        print(f"grasptransfer {__version__}, Python {platform.python_version()}, {platform.machine()}")
        sys.exit(0)
    handler = RichHandler(console=Console(stderr=True), show_path=False, show_time=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    try:
        code = parsed(arguments, COMMANDS, GROUPS)()
    except GraspTransferError as error:
        _print_error(str(error))
        sys.exit(2)
    except ModuleNotFoundError as error:
        extra = _extra_with(error.name or "")
        if extra is None:
            raise
        _print_error(f"needs the package {error.name}. pip install 'grasptransfer[{extra}]'")
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)  # Shells report Ctrl-C so; what long commands have finished is on disk.
    except BrokenPipeError:  # whoever read the output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)  # as shells report it
    except OSError as error:
        if error.errno not in FULL:
            raise
        _print_error(f"{error.filename or 'a file'}: cannot be written. {error.strerror}")
        sys.exit(2)
    sys.exit(code)


def _print_error(text: str) -> None:
    Console(stderr=True).print("[bold red]error:[/]", escape(text), highlight=False, soft_wrap=True)


def _extra_with(package: str) -> str | None:
    """The extra of this distribution that installs the package; None if no extra does."""
    for requirement in requires("grasptransfer") or []:
        found = re.match(r"([\w.-]+).*\bextra == ['\"](\w+)['\"]", requirement)
        if found and found[1] == package and found[2] not in ("dev", "test"):
            return found[2]
    return None
