"""Calls a function in threads and yields the results in order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from typing import TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


def in_turn(function: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[tuple[_T, _R]]:
    """Yields each item with the function's result, in order. There is one thread for each processor.

    The threads are only a few items ahead of the caller, so few results are in memory. For one item alone no
    thread is started.
    """
    workers = os.cpu_count() or 1
    waiting: deque[tuple[_T, Future[_R]]] = deque()
    following = iter(items)
    first_two = list(islice(following, 2))
    if len(first_two) < 2:
        yield from ((item, function(item)) for item in first_two)
        return
    with ThreadPoolExecutor(workers) as threads:
        for item in chain(first_two, following):
            waiting.append((item, threads.submit(function, item)))
            if len(waiting) > 2 * workers:
                first, future = waiting.popleft()
                yield first, future.result()
        for item, future in waiting:
            yield item, future.result()
