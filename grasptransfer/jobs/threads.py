"""How many threads a process uses: `cores` for our own, one for BLAS beside them, a share for each worker."""

import os
import threading
from contextlib import contextmanager
from functools import cache
from typing import Any

# What BLAS, OpenMP (PyTorch) and numba read when they load.
LIMITS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

_lock = threading.Lock()
_holders = 0
_limit: Any = None


def cores() -> int:
    """Threads that this process may use: its cores, or fewer where `OMP_NUM_THREADS` says so."""
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(found, _number("OMP_NUM_THREADS") or found)


def limited(threads: int) -> dict[str, str]:
    """Environment of a process that uses at most so many threads; lower limits stay as they are."""
    return {name: str(min(threads, _number(name) or threads)) for name in LIMITS}


def _number(name: str) -> int | None:
    """A limit from the environment; None if it is missing or not a number."""
    text = os.environ.get(name, "").split(",")[0].strip()
    return int(text) if text.isdecimal() and int(text) > 0 else None


@cache
def _controller():
    import scipy.linalg  # noqa: F401  its BLAS must be loaded to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def single_blas_thread():
    """Within the block BLAS uses one thread, in the whole process.

    BLAS threads wait by spinning: beside other work, each of many small products then takes ten times as
    long. Calls may overlap in several threads; the last to leave restores the setting.
    """
    global _holders, _limit
    with _lock:
        _holders += 1
        if _holders == 1:
            _limit = _controller().limit(limits=1, user_api="blas")
    try:
        yield
    finally:
        with _lock:
            _holders -= 1
            if _holders == 0:
                _limit.restore_original_limits()
