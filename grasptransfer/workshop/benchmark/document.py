"""The JSON document of a benchmark: settings, machine, rows and summary."""

import json
import os
import platform
from pathlib import Path

import numpy as np

from grasptransfer import __version__
from grasptransfer.files import write_whole


def document(benchmark: str, *, settings: dict, rows: list[dict], summary: dict) -> dict:
    """One benchmark run, as every `bench` command writes it.

    Args:
        benchmark: name of the command.
        settings: all settings of the run.
        rows: one dictionary for each measured unit.
        summary: figures over all rows.
    """
    return {
        "benchmark": benchmark,
        "version": __version__,
        "settings": settings,
        "machine": {
            "processor": processor_name(),
            "architecture": platform.machine(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "rows": rows,
        "summary": summary,
    }


def processor_name() -> str:
    """What the processor calls itself, as far as the system says."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def write_document(result: dict, path: Path):
    """Write a document whole or not at all; NaN becomes null."""
    write_whole(path, json.dumps(plain(result), indent=1).encode())


def plain(value):
    """Numbers, texts, lists and dictionaries alone, as JSON knows them; NaN becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
