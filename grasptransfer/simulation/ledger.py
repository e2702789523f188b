"""Results as JSON lines: appended one by one, so that an interrupted run goes on where it stopped."""

import fcntl
import json
import logging
from pathlib import Path

from grasptransfer.errors import SettingsError
from grasptransfer.simulation.outcome import TrialResult, TrialStatus, result_from_data

LOG = logging.getLogger(__name__)
VERSION = 1


def read_results(path: str | Path) -> dict[str, TrialResult]:
    """Finished trials by their key; half a last line, of an interrupted run, is left out.

    Raises:
        SettingsError: the file cannot be read or holds something else.
    """
    path = Path(path)
    if not path.exists():
        return {}
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError("cannot be read", path=path, fix=str(error)) from error
    found, unreadable = {}, []
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            data = json.loads(line)
            version, key = data.pop("version"), data.pop("key")
            if version != VERSION:
                raise SettingsError(
                    f"line {number} has another version", path=path, value=version, choices=[VERSION]
                )
            result = result_from_data(data)
        except (json.JSONDecodeError, AttributeError, KeyError, TypeError):
            unreadable.append(number)
            continue
        if result.status is not TrialStatus.CRASHED:  # a crashed trial is run again
            found[key] = result
    if unreadable and not found and len(unreadable) > 1:
        raise SettingsError("holds no trial results", path=path, key=f"line {unreadable[0]}")
    for number in unreadable:
        LOG.warning("%s: line %d is cut off; its trial runs again", path, number)
    return found


class Ledger:
    """Appends results to a file; several runs may share it."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "ab+", buffering=0)  # noqa: SIM115  (open as long as the ledger)
        except OSError as error:
            raise SettingsError("cannot be written", path=self.path, fix=str(error)) from error

    def close(self):
        """Close the file."""
        self._file.close()

    def add(self, key: str, result: TrialResult):
        """Append one line; it is in the file when this returns."""
        line = json.dumps({"version": VERSION, "key": key, **result.as_data()}) + "\n"
        fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            if self._file.seek(0, 2) > 0:
                self._file.seek(-1, 2)
                if self._file.read(1) != b"\n":  # half a line of an interrupted run
                    line = "\n" + line
            self._file.write(line.encode())
        finally:
            fcntl.flock(self._file, fcntl.LOCK_UN)
