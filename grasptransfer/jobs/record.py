"""Finished pieces of work as JSON lines: appended one by one, so that a killed run resumes."""

import fcntl
import json
import logging
from pathlib import Path

from grasptransfer.errors import SettingsError

LOG = logging.getLogger(__name__)


class Record:
    """A file of JSON objects, one a line; several processes may append to it at once.

    The record is a context manager. Without a path it keeps nothing.

    Args:
        path: path of the file; folders above it are made with the first line.
    """

    def __init__(self, path: str | Path | None):
        self.path = None if path is None else Path(path)
        self._file = None

    def __enter__(self) -> "Record":
        return self

    def __exit__(self, *_):
        if self._file is not None:
            self._file.close()
            self._file = None

    def lines(self) -> list[dict]:
        """All objects in the file; a line that a killed run cut off is left out with a warning.

        Raises:
            SettingsError: the file cannot be read, or is no record.
        """
        if self.path is None or not self.path.exists():
            return []
        try:
            texts = self.path.read_text(encoding="utf-8").split("\n")
        except (OSError, UnicodeDecodeError) as error:
            raise SettingsError("cannot be read", path=self.path, fix=str(error)) from error
        found, unreadable = [], []
        for number, text in enumerate(texts, 1):
            try:
                line = json.loads(text) if text else None
            except json.JSONDecodeError:
                unreadable.append(number)
                continue
            if isinstance(line, dict):
                found.append(line)
            elif text:
                unreadable.append(number)
        if unreadable and (not found) and len(unreadable) > 1:
            raise SettingsError("is no record of finished work", path=self.path, key=f"line {unreadable[0]}")
        for number in unreadable:
            LOG.warning("%s: line %d is cut off; what it held is done again", self.path, number)
        return found

    def add(self, line: dict) -> None:
        """Append one line; it is in the file when this returns.

        Raises:
            SettingsError: the file cannot be written.
        """
        if self.path is None:
            return
        text = json.dumps(line) + "\n"
        try:
            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = open(self.path, "ab+", buffering=0)  # noqa: SIM115  (open as long as the record)
            fcntl.flock(self._file, fcntl.LOCK_EX)
            try:
                if self._file.seek(0, 2) > 0:
                    self._file.seek(-1, 2)
                    if self._file.read(1) != b"\n":  # half a line of a killed run
                        text = "\n" + text
                self._file.write(text.encode())
            finally:
                fcntl.flock(self._file, fcntl.LOCK_UN)
        except OSError as error:
            reason = error.strerror or str(error)
            raise SettingsError("cannot be written", path=self.path, fix=reason) from error
