"""Trials on a Dask cluster: the same trial, in the processes of other machines."""

from collections.abc import Iterator, Sequence

from grasptransfer.errors import SettingsError
from grasptransfer.simulation.job import Job
from grasptransfer.simulation.outcome import TrialResult
from grasptransfer.simulation.pool import crashed_trial
from grasptransfer.simulation.setup import Setup, execute

CONNECT_TIME = 20  # s


def run_on_cluster(setup: Setup, jobs: Sequence[Job], address: str) -> Iterator[tuple[int, TrialResult]]:
    """Index and result of each job, as they end.

    Args:
        address: of a Dask scheduler, such as `tcp://10.0.0.1:8786`; its workers need this package.

    Raises:
        SettingsError: Dask is not installed, or nobody answers at the address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise SettingsError(
            "needs Dask", key="cluster", value=address, fix="pip install 'grasptransfer[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=CONNECT_TIME, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise SettingsError(
            "no Dask scheduler answers there", key="cluster", value=address, fix=str(error)
        ) from error
    with client:
        shared = client.scatter(setup, broadcast=True, hash=False)
        # Not pure: the same trial may be asked for again after a crash.
        futures = {client.submit(execute, shared, job, pure=False): i for i, job in enumerate(jobs)}
        for future in as_completed(list(futures), loop=client.loop):
            index = futures[future]
            if future.status == "finished":
                yield index, future.result()
            else:
                cause = future.exception()
                if type(cause).__name__ != "KilledWorker":
                    future.result()  # our own fault: raise it here
                yield index, crashed_trial(jobs[index], f"the cluster lost this trial: {cause}")
