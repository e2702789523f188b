"""From words on the command line to a command with its settings, ready to run."""

import contextlib
import functools
import io
import re
from collections.abc import Callable, Mapping
from dataclasses import make_dataclass
from importlib import import_module
from typing import Annotated, Any, NoReturn, Union

import tyro

from grasptransfer.errors import GraspTransferError, SettingsError

Command = Callable[..., int]
Table = dict[str, str]  # name of a command -> `module:function` of `grasptransfer.cli`, or a group's own name
PROGRAM = "grasptransfer"
COMPLETION, SHELLS = "--print-completion", ("bash", "zsh", "fish", "tcsh")
FLAG = re.compile(r"--[A-Za-z][\w-]*")


def parsed(arguments: list[str], commands: Table, groups: Mapping[str, Table]) -> Callable[[], int]:
    """The command with its settings, ready to run; no other command's modules are imported.

    Raises:
        GraspTransferError: an unknown command or option, or settings that refuse a value.
        SystemExit: help was asked for, or something is missing; help or error has been printed.
    """
    program = PROGRAM
    while arguments and arguments[0] in commands and commands[arguments[0]] in groups:
        program, commands = f"{program} {arguments[0]}", groups[commands[arguments[0]]]
        arguments = arguments[1:]
    if not arguments:
        _parser(commands, groups, program)(args=["--help"])  # which ends here
    name = arguments[0]
    if name == COMPLETION:
        print_completion(arguments[1:], _parser(commands, groups, program))
    if name in commands:
        command = functools.partial(tyro.cli, _deferred(_loaded(commands[name])), prog=f"{program} {name}")
        return _run(_with_flat_names(command), arguments[1:], f"{program} {name}")
    if not name.startswith("-"):
        raise SettingsError("is no command", key=program, value=name, choices=commands)
    return _run(_parser(commands, groups, program), arguments, program)


def print_completion(shells: list[str], parse: Callable[..., Any]) -> NoReturn:
    """Print what a shell reads to complete commands and options, and exit.

    Raises:
        SettingsError: an unknown shell.
    """
    if len(shells) != 1 or shells[0] not in SHELLS:
        raise SettingsError("needs one shell", key=COMPLETION, value=" ".join(shells), choices=SHELLS)
    parse(args=["--tyro-print-completion", shells[0]])
    raise AssertionError("tyro ends the process once it has printed")


def _run(parse: Callable[..., Callable[[], int]], arguments: list[str], program: str) -> Callable[[], int]:
    """Parse silently first: what our own settings refuse is told in their words, not in the parser's."""
    try:
        return parse(args=arguments, console_outputs=False)
    except SystemExit as stopped:
        cause: BaseException | None = stopped
        while cause is not None and not isinstance(cause, GraspTransferError):
            cause = cause.__cause__ or cause.__context__
        if cause is not None:
            raise cause from None
        if stopped.code:
            _check_flags(parse, arguments, program)
    return parse(args=arguments)


def _check_flags(parse: Callable[..., Any], arguments: list[str], program: str) -> None:
    """
    Raises:
        SettingsError: an option that the command does not have.
    """
    help_text = io.StringIO()
    with contextlib.redirect_stdout(help_text), contextlib.suppress(SystemExit):
        parse(args=["--help"])
    known = sorted(set(FLAG.findall(help_text.getvalue())))
    for argument in arguments:
        name = argument.split("=")[0]
        if FLAG.fullmatch(name) and name.replace("_", "-") not in known:
            error = SettingsError("", value=name, choices=known)
            fix = f"Did you mean {error.meant()}?" if error.meant() else f"See {program} --help"
            raise SettingsError("is no option", key=program, value=name, fix=fix)


def _parser(commands: Table, groups: Mapping[str, Table], program: str) -> Callable[..., Callable[[], int]]:
    """Of all commands of a table at once, for help and for shell completion."""
    every = {
        name: _group(name, groups[place]) if place in groups else _deferred(_loaded(place))
        for name, place in commands.items()
    }
    return _with_flat_names(functools.partial(tyro.extras.subcommand_cli_from_dict, every, prog=program))


def _with_flat_names(parse: Callable[..., Any]) -> Callable[..., Callable[[], int]]:
    return functools.partial(parse, config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes))


def _deferred(command: Command) -> Callable[..., Callable[[], int]]:
    """The command as tyro is to call it: settings are checked while parsing, the work is done afterwards."""

    @functools.wraps(command)
    def deferred(*positional: Any, **options: Any) -> Callable[[], int]:
        return functools.partial(command, *positional, **options)

    return deferred


def _loaded(place: str) -> Command:
    module, name = place.split(":")
    return getattr(import_module(f"grasptransfer.cli.{module}"), name)


def _group(name: str, commands: Table) -> Callable[..., Callable[[], int]]:
    """A command that has commands of its own: a class with the chosen one as its field."""
    kinds = []
    for inner, place in commands.items():
        command = _loaded(place)
        sentence = (command.__doc__ or "").partition("\n")[0]
        inside = tyro.conf.subcommand(inner, constructor=_deferred(command), description=sentence)
        kinds.append(Annotated[Any, inside])
    text = f"{' | '.join(commands)}: see `{PROGRAM} {name} --help`."
    kind = Union[tuple(kinds)]  # noqa: UP007  as many as the group has
    run = {"__call__": lambda self: self.command(), "__doc__": text}
    return make_dataclass(name, [("command", kind)], namespace=run)
