"""Independent pieces of work in several threads, with results in their order."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from trisquare._support.arrays import whole_number

if TYPE_CHECKING:  # imported only if there are several threads
    from concurrent.futures import Future

T = TypeVar("T")

AHEAD = 2
"""Number of pieces of work per thread that are started and not yet taken: a slow one does not stop
the other threads."""


def thread_count(threads: int | None, pieces: int) -> int:
    """Return the number of threads for a number of pieces of work.

    Parameters
    ----------
    threads : int or None
        The number that the user asks for; None for all cores that this process may use.
    pieces : int

    Raises
    ------
    TypeError
        If `threads` is not a whole number.
    ValueError
        If it is below 1.
    """
    count = usable_cores() if threads is None else whole_number(threads, "threads")
    if count < 1:
        raise ValueError(f"threads must be at least 1, not {count}")
    return max(1, min(count, pieces))


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_order(works: Iterable[Callable[[], T]], threads: int) -> Generator[T, None, None]:
    """Do pieces of work, started in their order, and yield their results in the same order.

    An error of a piece of work is raised in place of its result. Close the generator to stop:
    pieces that have not started are then dropped.
    """
    if threads == 1:
        for work in works:
            yield work()
        return
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(threads)
    try:
        begun: deque[Future[T]] = deque()
        for work in works:
            begun.append(pool.submit(work))
            if len(begun) == AHEAD * threads:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def ahead(items: Iterable[T], count: int) -> Generator[T, None, None]:
    """Iterate in a separate thread, `count` items ahead, and yield the items.

    An error of the iteration is raised in place of the item. Close the generator to stop.
    """
    from concurrent.futures import ThreadPoolExecutor

    iterator, end = iter(items), object()
    pool = ThreadPoolExecutor(1)
    try:
        begun = deque(pool.submit(next, iterator, end) for _ in range(count))
        while (item := begun.popleft().result()) is not end:
            begun.append(pool.submit(next, iterator, end))
            yield item  # type: ignore[misc]  # it is not `end`
    finally:
        pool.shutdown(cancel_futures=True)


class Turns:
    """Order of threads by their numbers, from 0 on; each number passes once."""

    def __init__(self) -> None:
        self._next = 0
        self._changed = threading.Condition()

    @contextmanager
    def turn(self, number: int) -> Iterator[None]:
        """Wait until all lower numbers have passed, and let the next one pass at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._next == number)
            try:
                yield
            finally:
                self._next += 1
                self._changed.notify_all()
