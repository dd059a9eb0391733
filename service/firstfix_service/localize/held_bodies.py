"""Bodies of queries in memory: their bytes are limited for all callers together, and for each of them."""

from __future__ import annotations

from collections import Counter

from firstfix.errors import Overloaded


class HeldBodies:
    """Counts the bytes of bodies in memory. For use by one event loop.

    One caller has at most half of the limit, so that it leaves room to others. One body alone may have more.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._of_caller: Counter[str] = Counter()
        self.bytes = 0

    def add(self, caller: str, count: int, *, body_bytes: int) -> None:
        """Counts bytes of a body. They count also if this raises: give them back.

        Args:
            body_bytes: of this body so far, these included.

        Raises:
            Overloaded: the caller, or all callers together, have too many.
        """
        self.bytes += count
        self._of_caller[caller] += count
        held = self._of_caller[caller]
        if self.bytes > self._max_bytes:
            raise Overloaded("too many bodies arrive at the same time: try again")
        if held > body_bytes and held > self._max_bytes // 2:
            raise Overloaded("too many bodies of this caller arrive at the same time: try again")

    def give_back(self, caller: str, count: int) -> None:
        """Ends the count of these bytes."""
        self.bytes -= count
        self._of_caller[caller] -= count
        if not self._of_caller[caller]:
            del self._of_caller[caller]
