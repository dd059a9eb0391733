"""The memory that the bodies of waiting queries take, shared among callers."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass

from firstfix.errors import Overloaded


class HeldBodies:
    """Counts the bytes of bodies in memory, of both transports together. Thread-safe.

    One caller has at most half of the limit, so that it leaves room to others. One body alone may have more.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._of_caller: Counter[str] = Counter()
        self.bytes = 0

    def add(self, caller: str, count: int, *, body_bytes: int) -> None:
        """Counts bytes of a body.

        Args:
            caller: empty: it is not known yet.
            body_bytes: of this body so far, these included.

        Raises:
            Overloaded: the caller, or all callers together, would have too many. They are not counted.
        """
        with self._lock:
            if self.bytes + count > self._max_bytes:
                raise Overloaded("too many bodies arrive at the same time: try again")
            self._add_to_share(caller, count, body_bytes)
            self.bytes += count

    def name_caller(self, caller: str, count: int) -> None:
        """Counts a whole body, whose caller was not known, for its caller.

        Raises:
            Overloaded: the caller would have too many. The body still counts, for nobody.
        """
        with self._lock:
            self._add_to_share(caller, count, count)
            self._take_from_share("", count)

    def give_back(self, caller: str, count: int) -> None:
        """Ends the count of these bytes."""
        with self._lock:
            self._take_from_share(caller, count)
            self.bytes -= count

    def _take_from_share(self, caller: str, count: int) -> None:
        self._of_caller[caller] -= count
        if not self._of_caller[caller]:
            del self._of_caller[caller]

    def _add_to_share(self, caller: str, count: int, body_bytes: int) -> None:
        held = self._of_caller[caller] + count
        if caller and held > body_bytes and held > self._max_bytes // 2:
            raise Overloaded("too many bodies of this caller arrive at the same time: try again")
        self._of_caller[caller] = held


@dataclass
class HeldBody:
    """A whole body that counts from before it is known who asks.

    Attributes:
        caller: for whom it counts; empty: for nobody yet.
    """

    bodies: HeldBodies
    size: int
    caller: str = ""

    def name_caller(self, caller: str) -> None:
        """Counts the body for its caller.

        Raises:
            Overloaded: as ``HeldBodies.name_caller``.
        """
        self.bodies.name_caller(caller, self.size)
        self.caller = caller

    def give_back(self) -> None:
        """Ends the count."""
        self.bodies.give_back(self.caller, self.size)
