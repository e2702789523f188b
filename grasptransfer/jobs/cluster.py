"""Pieces of work on a Dask cluster: the same function, in the processes of other machines."""

from collections.abc import Callable, Iterator, Sequence

from grasptransfer.errors import SettingsError
from grasptransfer.jobs.run import Ended, LostError

CONNECT_TIME = 20  # s


def run_on_cluster(
    task: Callable, pieces: Sequence[tuple], address: str, *, shared: tuple = ()
) -> Iterator[Ended]:
    """Yield `task(*shared, *piece)` for every piece, as soon as it has ended.

    Args:
        task: a function of a module, so that other processes can import it.
        pieces: arguments of each piece.
        address: address of a Dask scheduler, such as `tcp://10.0.0.1:8786`; its workers need this package.
        shared: first arguments of every call, sent to each machine once.

    Raises:
        SettingsError: Dask is not installed, or no scheduler answers at the address.
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
        given = [client.scatter(one, broadcast=True, hash=False) for one in shared]
        # The task is called impure, because the same piece may be asked for again after a crash.
        futures = {client.submit(task, *given, *piece, pure=False): i for i, piece in enumerate(pieces)}
        for future in as_completed(list(futures), loop=client.loop):
            if future.status == "finished":
                yield Ended(futures[future], future.result())
                continue
            cause = future.exception()
            if type(cause).__name__ == "KilledWorker":
                cause = LostError(f"the cluster lost this piece: {cause}")
            yield Ended(futures[future], error=cause)
