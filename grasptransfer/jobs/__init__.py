"""Many pieces of work in parallel: bounded in threads, resumed by content, ended cleanly.

In: a function of a module and the arguments of each piece. Out: the pieces as they end, in any order.

    for ended in run(measure, [("mug", 1), ("mug", 2)], workers=2, shared=(settings,)):
        rows[ended.index] = ended.result()          # measure(settings, "mug", 1)

| name | what it does |
| --- | --- |
| `run` | computes pieces in processes of their own; a death costs its piece alone, which is tried again |
| `Workers` | the same processes for several `run`s |
| `run_fresh` | one piece in one fresh process |
| `run_on_cluster` | computes pieces on a Dask cluster |
| `Record` | finished pieces in a file of JSON lines, from which a killed run goes on |
| `single_blas_thread`, `cores` | the one policy of threads inside a process |

No worker outlives the process that started it: Ctrl-C and SIGTERM end the workers in order, and after
`kill -9` the kernel ends them (`worker.py`). Results are written whole (`files.write_whole`), so that a piece
is either done or not begun, and doing it again gives the same bytes. The name of a piece in a record or a
folder is a key made from everything that the piece depends on (`files.content_key`).
"""

from grasptransfer.jobs.cluster import run_on_cluster
from grasptransfer.jobs.record import Record
from grasptransfer.jobs.run import Ended, LostError, Workers, run, run_fresh
from grasptransfer.jobs.threads import cores, single_blas_thread

__all__ = [
    "Ended",
    "LostError",
    "Record",
    "Workers",
    "cores",
    "run",
    "run_fresh",
    "run_on_cluster",
    "single_blas_thread",
]
