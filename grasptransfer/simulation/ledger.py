"""Results of trials in a file, so that an interrupted run goes on where it stopped."""

import logging
from pathlib import Path

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import Record
from grasptransfer.simulation.outcome import TrialResult, TrialStatus, result_from_data

LOG = logging.getLogger(__name__)
VERSION = 1


def read_results(path: str | Path | None) -> dict[str, TrialResult]:
    """Finished trials by their key; half a last line, of an interrupted run, is left out.

    Raises:
        SettingsError: the file cannot be read or holds something else.
    """
    found, unknown = {}, 0
    for data in Record(path).lines():
        try:
            version, key = data.pop("version"), data.pop("key")
            if version != VERSION:
                raise SettingsError("has another version", path=path, value=version, choices=[VERSION])
            result = result_from_data(data)
        except (AttributeError, KeyError, TypeError):
            unknown += 1
            continue
        if result.status is not TrialStatus.CRASHED:  # A crashed trial is run again.
            found[key] = result
    if unknown and not found:
        raise SettingsError("holds no trial results", path=path)
    if unknown:
        LOG.warning("%s: %d lines are no trial results and are left out", path, unknown)
    return found


def line_of(key: str, result: TrialResult) -> dict:
    """One trial as `read_results` reads it."""
    return {"version": VERSION, "key": key, **result.as_data()}
