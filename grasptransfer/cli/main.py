"""All commands of `grasptransfer …`, and how they end.

Exit codes: 0 done; 1 ran, and found no usable grasp or missed a bar; 2 wrong input.
"""

import functools
import logging
import re
import sys
from collections.abc import Callable
from importlib.metadata import requires
from typing import Any

import tyro
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape

from grasptransfer.cli.annotate import annotate
from grasptransfer.cli.bench import COMMANDS as BENCHMARKS
from grasptransfer.cli.category import COMMANDS as CATEGORY
from grasptransfer.cli.grasps import convert, frames
from grasptransfer.cli.serve import serve
from grasptransfer.cli.train import train
from grasptransfer.cli.transfer import demo, simulate, transfer
from grasptransfer.errors import GraspTransferError, check_seed


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    handler = RichHandler(console=Console(stderr=True), show_path=False, show_time=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    commands, program = COMMANDS, "grasptransfer"
    if arguments and arguments[0] in GROUPS:
        commands, program = GROUPS[arguments[0]], f"grasptransfer {arguments[0]}"
        arguments = arguments[1:]
    commands = {name: _checked(command) for name, command in commands.items()}
    try:
        code = tyro.extras.subcommand_cli_from_dict(commands, prog=program, args=arguments)
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
        sys.exit(130)  # as a shell reports it; finished parts of long commands are on disk
    sys.exit(code)


def _print_error(text: str) -> None:
    Console(stderr=True).print("[bold red]error:[/]", escape(text), highlight=False, soft_wrap=True)


def _extra_with(package: str) -> str | None:
    """The extra of this distribution that installs the package; None if it is none of theirs."""
    for requirement in requires("grasptransfer") or []:
        found = re.match(r"([\w.-]+).*\bextra == ['\"](\w+)['\"]", requirement)
        if found and found[1] == package and found[2] not in ("dev", "test"):
            return found[2]
    return None


def _checked(command: Callable[..., int]) -> Callable[..., int]:
    """The command, refusing a wrong seed before it computes anything."""

    @functools.wraps(command)
    def checked(*positional, **options) -> int:
        check_seed(options.get("seed", 0))
        return command(*positional, **options)

    return checked


def _group(name: str) -> Callable[[], int]:
    def show() -> int:
        main([name, "--help"])
        return 0

    show.__doc__ = f"{' | '.join(GROUPS[name])}: see `grasptransfer {name} --help`."
    return show


GROUPS: dict[str, dict[str, Callable[..., Any]]] = {
    "category": CATEGORY,
    "bench": BENCHMARKS,
}
COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": demo,
    "transfer": transfer,
    "category": _group("category"),
    "train": train,
    "annotate": annotate,
    "simulate": simulate,
    "serve": serve,
    "convert": convert,
    "frames": frames,
    "bench": _group("bench"),
}
