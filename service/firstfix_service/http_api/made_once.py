"""Answers that are made once for each state of what they tell of, and kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar


class HasSize(Protocol):
    """Something of a known size, so that it can be kept."""

    @property
    def size_bytes(self) -> int:
        """Memory that it takes."""
        ...


Made = TypeVar("Made", bound=HasSize)


@dataclass
class _Place(Generic[Made]):
    """The last thing made under one key. Who makes it has the lock: others wait for it, and make none."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    state: Hashable = None
    made: Made | None = None

    @property
    def size_bytes(self) -> int:
        return 0 if self.made is None else self.made.size_bytes


class MadeOnce(Generic[Made]):
    """Things by key, each made once for each state. Thread-safe.

    Args:
        most: keys.
        max_bytes: of all that is kept. The one used last is kept, however large it is.
    """

    def __init__(self, most: int, max_bytes: int) -> None:
        self._most = most
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._places: OrderedDict[Hashable, _Place[Made]] = OrderedDict()

    def of(self, key: Hashable, state: Hashable, make: Callable[[], Made]) -> Made:
        """Value made for this state; it is made now if it was not.

        Args:
            state: looked at before ``make`` reads: what it makes may be newer, but never older.
        """
        with self._lock:
            place = self._places.setdefault(key, _Place())
            self._places.move_to_end(key)
        with place.lock:
            if place.made is None or place.state != state:
                place.made, place.state = make(), state
                self._drop_old()
            return place.made

    def _drop_old(self) -> None:
        """Drop those not used for longest, beyond the limits."""
        with self._lock:
            while len(self._places) > 1 and (
                len(self._places) > self._most
                or sum(place.size_bytes for place in self._places.values()) > self._max_bytes
            ):
                self._places.popitem(last=False)
