"""Prepare the next batches in a thread while the network works on this one."""

from collections import OrderedDict, deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item", bound=Hashable)
Made = TypeVar("Made")


def prefetch(
    make: Callable[[Item], Made], items: Iterable[Item], *, ahead: int = 3, reuse: int = 0
) -> Iterator[Made]:
    """`map(make, items)`, in order, computed up to `ahead` items before they are asked for.

    Args:
        make: function that prepares one item.
        items: what to prepare, in order.
        ahead: how many prepared items may wait.
        reuse: an item that comes again within this many different ones is made only once.
    """
    made: OrderedDict[Item, Future[Made]] = OrderedDict()
    with ThreadPoolExecutor(1) as pool:
        waiting: deque[Future[Made]] = deque()
        for item in items:
            if item not in made:
                made[item] = pool.submit(make, item)
            waiting.append(made[item])
            while len(made) > max(reuse, 1) + ahead:
                made.popitem(last=False)
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
