"""Merging of what parts of a recording hold, by time: of its files, and of the chunks of a file."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Part(Generic[_Item]):
    """A part that is not read before its time.

    Attributes:
        start_ns: no item is earlier.
        items: reads the items with their times, in the order of time.
    """

    start_ns: int
    items: Callable[[], Iterator[tuple[int, _Item]]]


def in_time_order(parts: Iterable[Part[_Item]]) -> Iterator[tuple[int, _Item]]:
    """Yield the items of all parts in the order of time; of equal times, in the parts' order.

    A part is opened when its first item may be the next one: parts that follow each other are never open
    together.
    """
    waiting = sorted(enumerate(parts), key=lambda one: (one[1].start_ns, one[0]), reverse=True)
    if len(waiting) == 1:
        yield from waiting[0][1].items()
        return
    heap: list[tuple[int, int, _Item, Iterator[tuple[int, _Item]]]] = []
    while waiting or heap:
        while waiting and (not heap or waiting[-1][1].start_ns <= heap[0][0]):
            number, part = waiting.pop()
            _push_next(heap, number, part.items())
        if heap:
            time_ns, number, item, items = heapq.heappop(heap)
            yield time_ns, item
            _push_next(heap, number, items)


def _push_next(
    heap: list[tuple[int, int, _Item, Iterator[tuple[int, _Item]]]],
    number: int,
    items: Iterator[tuple[int, _Item]],
) -> None:
    found = next(items, None)
    if found is not None:
        heapq.heappush(heap, (found[0], number, found[1], items))
