"""Fitted numbers on disk: a YAML file of blocks, each with the command that wrote it and the date.

    ranking:
      command: grasptransfer bench calibration --write --json out.json
      date: '2026-11-24'
      values: {entry: 0.32, clearance: 0.91}

Numbers that no command fits stand there as well; their block says how they were chosen.
"""

import datetime
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

import yaml
from pydantic import Field

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import GraspTransferError
from grasptransfer.files import write_whole
from grasptransfer.yaml_models import Strict, parse


class Fit(Strict):
    """One block of numbers and where they come from.

    Args:
        command: that wrote them, or a sentence on how they were chosen.
        date: date of the fit, year-month-day.
        values: each number by its name.
        fitted_to: checksum of the trained network that they belong to, where they belong to one.
    """

    command: str
    date: str = Field(pattern=r"^\d{4}-\d{2}-\d{2}$")
    values: dict[str, float]
    fitted_to: str | None = None

    @staticmethod
    def today(
        values: Mapping[str, float], *, command: str | None = None, fitted_to: str | None = None
    ) -> "Fit":
        """A block of today's date; without a command, by the command line of this process."""
        program = Path(sys.argv[0]).name.replace("__main__.py", "grasptransfer")
        rounded = {key: round(float(value), 4) for key, value in values.items()}
        return Fit(
            command=command or shlex.join([program, *sys.argv[1:]]),
            date=datetime.date.today().isoformat(),
            values=rounded,
            fitted_to=fitted_to,
        )


def read_fits(
    path: Path, names: Mapping[str, tuple[str, ...]], *, error: type[GraspTransferError]
) -> dict[str, Fit]:
    """The blocks of a file of fitted numbers.

    Args:
        names: the blocks that the file must hold, and for each block the names of its values.

    Raises:
        error: the file is missing or unreadable, or lacks a block or value or holds an unknown one.
    """
    data = read_yaml(path, error=error)
    _same(path, "block", tuple(data), tuple(names), error)
    fits = {name: parse(Fit, data[name], path, key=name, error=error) for name in names}
    for name, fit in fits.items():
        _same(path, f"{name}.values", tuple(fit.values), names[name], error)
    return fits


def write_fits(path: Path, fits: Mapping[str, Fit]) -> None:
    """Write a file of fitted numbers, whole or not at all.

    Raises:
        SettingsError: the file cannot be written.
    """
    data = {name: fit.model_dump(exclude_none=True) for name, fit in fits.items()}
    write_whole(path, yaml.safe_dump(data, sort_keys=False, width=100).encode())


def _same(
    path: Path, key: str, found: tuple[str, ...], wanted: tuple[str, ...], error: type[GraspTransferError]
) -> None:
    for name in wanted:
        if name not in found:
            raise error("lacks a fitted number", path=path, key=key, value=name, choices=list(wanted))
    for name in found:
        if name not in wanted:
            raise error("holds an unknown number", path=path, key=key, value=name, choices=list(wanted))
