"""All commands of `grasptransfer …`, and how they end.

Exit codes: 0 done; 1 ran, and found no usable grasp or missed a bar; 2 wrong input.
"""

import functools
import logging
import re
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import requires

import tyro
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape

from grasptransfer.errors import GraspTransferError

Command = Callable[..., int]

# Each command as `module:function` of `grasptransfer.cli`; modules are imported when they are needed.
GROUPS: dict[str, dict[str, str]] = {
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
        "refusal": "bench.pictures:refusal",
        "grasp": "bench.grasps:grasp",
        "calibration": "bench.grasps:calibration",
        "engines": "bench.grasps:engines",
    },
}
COMMANDS: dict[str, str] = {
    "demo": "transfer:demo",
    "transfer": "transfer:transfer",
    "category": "category",
    "train": "train:train",
    "annotate": "annotate:annotate",
    "simulate": "transfer:simulate",
    "serve": "serve:serve",
    "convert": "grasps:convert",
    "frames": "grasps:frames",
    "bench": "bench",
}


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    handler = RichHandler(console=Console(stderr=True), show_path=False, show_time=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    try:
        code = _parsed(arguments)()
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
    sys.exit(code)


def _parsed(arguments: list[str]) -> Callable[[], int]:
    """The command with its settings, ready to run.

    Raises:
        GraspTransferError: the settings refuse a value.
        SystemExit: help was asked for, or flags are wrong; help or error has been printed.
    """
    commands, program = COMMANDS, "grasptransfer"
    if arguments and arguments[0] in GROUPS:
        commands, program = GROUPS[arguments[0]], f"grasptransfer {arguments[0]}"
        arguments = arguments[1:]
    if arguments and arguments[0] in commands:  # no other command's modules are imported then
        command, program = _deferred(_loaded(commands[arguments[0]])), f"{program} {arguments[0]}"
        parse = functools.partial(tyro.cli, command, prog=program, args=arguments[1:])
    else:
        every = {name: _deferred(_loaded(place)) for name, place in commands.items()}
        parse = functools.partial(tyro.extras.subcommand_cli_from_dict, every, prog=program, args=arguments)
    parse = functools.partial(parse, config=(tyro.conf.OmitArgPrefixes,))
    try:
        return parse(console_outputs=False)
    except SystemExit as stopped:
        cause: BaseException | None = stopped
        while cause is not None and not isinstance(cause, GraspTransferError):
            cause = cause.__cause__ or cause.__context__
        if cause is not None:
            raise cause from None
    return parse()


def _deferred(command: Command) -> Callable[..., Callable[[], int]]:
    """The command as tyro is to call it: settings are checked while parsing, the work is done afterwards."""

    @functools.wraps(command)
    def deferred(*positional, **options) -> Callable[[], int]:
        return functools.partial(command, *positional, **options)

    return deferred


def _loaded(place: str) -> Command:
    if place in GROUPS:
        return _group(place)
    module, name = place.split(":")
    return getattr(import_module(f"grasptransfer.cli.{module}"), name)


def _print_error(text: str) -> None:
    Console(stderr=True).print("[bold red]error:[/]", escape(text), highlight=False, soft_wrap=True)


def _extra_with(package: str) -> str | None:
    """The extra of this distribution that installs the package; None if no extra does."""
    for requirement in requires("grasptransfer") or []:
        found = re.match(r"([\w.-]+).*\bextra == ['\"](\w+)['\"]", requirement)
        if found and found[1] == package and found[2] not in ("dev", "test"):
            return found[2]
    return None


def _group(name: str) -> Command:
    def show() -> int:
        main([name, "--help"])
        return 0

    show.__doc__ = f"{' | '.join(GROUPS[name])}: see `grasptransfer {name} --help`."
    return show
