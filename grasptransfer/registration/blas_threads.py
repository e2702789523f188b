"""Hold BLAS to one thread while our own threads work.

BLAS threads wait by spinning: beside other work, each of the many small products then takes ten
times as long. Calls may overlap in several threads; the last to leave restores the setting.
"""

import threading
from contextlib import contextmanager
from functools import cache
from typing import Any

_lock = threading.Lock()
_holders = 0
_limit: Any = None


@cache
def _controller():
    import scipy.linalg  # noqa: F401  its BLAS must be loaded to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def single_blas_thread():
    """Within the block BLAS uses one thread, in the whole process."""
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
