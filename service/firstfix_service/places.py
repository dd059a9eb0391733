"""A bounded number of long requests at a time; the next one is told so at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from firstfix.errors import Overloaded


class Places:
    """Counts what is under way. One event loop's.

    Args:
        what: for people: what there are too many of.
    """

    def __init__(self, limit: int, what: str) -> None:
        self._limit = limit
        self._what = what
        self.taken = 0

    @contextmanager
    def one(self) -> Iterator[None]:
        """
        Raises:
            Overloaded: all are taken.
        """
        if self.taken >= self._limit:
            raise Overloaded(f"{self._limit} {self._what} are under way: try again")
        self.taken += 1
        try:
            yield
        finally:
            self.taken -= 1
