"""Independent pieces of work in several threads, with results in their order."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from trisquare._support.arrays import whole_number

if TYPE_CHECKING:  # loaded where there are several threads
    from concurrent.futures import Future

T = TypeVar("T")

AHEAD = 2
"""Pieces of work begun and not yet taken, for each thread: one that takes long does not stop the
other threads."""


def thread_count(threads: int | None, pieces: int) -> int:
    """Return in how many threads so many pieces of work are done.

    Parameters
    ----------
    threads : int or None
        As a user asks for it; None for all cores that this process may use.
    pieces : int

    Raises
    ------
    TypeError
        If `threads` is no whole number.
    ValueError
        If it is below 1.
    """
    wanted = usable_cores() if threads is None else whole_number(threads, "threads")
    if wanted < 1:
        raise ValueError(f"threads must be at least 1, not {wanted}")
    return max(1, min(wanted, pieces))


def usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_order(works: Iterable[Callable[[], T]], threads: int) -> Generator[T, None, None]:
    """Do pieces of work, begun in their order, and yield their results in the same order.

    An error of a piece of work is raised in the place of its result. Close the generator to stop:
    what has not begun then is not done.
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
    """Iterate in a thread of its own, and yield the items, of which so many are made ahead.

    An error of the iteration is raised in the place of the item. Close the generator to stop.
    """
    from concurrent.futures import ThreadPoolExecutor

    iterator, end = iter(items), object()
    pool = ThreadPoolExecutor(1)
    try:
        begun = deque(pool.submit(next, iterator, end) for _ in range(count))
        while (item := begun.popleft().result()) is not end:
            begun.append(pool.submit(next, iterator, end))
            yield item  # type: ignore[misc]  # it is not the end
    finally:
        pool.shutdown(cancel_futures=True)


class Turns:
    """Lets threads pass one after another, by their numbers from 0 on; each number passes once."""

    def __init__(self) -> None:
        self._next = 0
        self._changed = threading.Condition()

    @contextmanager
    def turn(self, number: int) -> Iterator[None]:
        """Wait until all lower numbers have passed, and let the next one pass afterwards."""
        with self._changed:
            self._changed.wait_for(lambda: self._next == number)
            try:
                yield
            finally:
                self._next += 1
                self._changed.notify_all()
