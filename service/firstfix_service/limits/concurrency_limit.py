"""A limit of the long requests under way, of one caller and of all. One more is refused at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from firstfix.errors import Overloaded, QuotaExceeded


class ConcurrencyLimit:
    """Counts the requests under way. Belongs to one event loop.

    Args:
        limit: of all callers together.
        per_caller: of one caller, so that none takes the room of the others.
        what: the kind of request, for error messages.
    """

    def __init__(self, limit: int, per_caller: int, what: str) -> None:
        self._limit = limit
        self._per_caller = per_caller
        self._what = what
        self._taken: Counter[str] = Counter()

    @property
    def taken(self) -> int:
        """Number of requests under way."""
        return self._taken.total()

    @contextmanager
    def request(self, caller: str) -> Iterator[None]:
        """Count one request of a caller until the block ends.

        Raises:
            QuotaExceeded: the caller has reached its limit.
            Overloaded: all callers together have reached theirs.
        """
        if self._taken[caller] >= self._per_caller:
            text = f"{self._per_caller} {self._what} of this caller are under way: end one, or wait for it"
            raise QuotaExceeded(text, retry_after_s=1.0)
        if self.taken >= self._limit:
            raise Overloaded(f"{self._limit} {self._what} are under way: try again")
        self._taken[caller] += 1
        try:
            yield
        finally:
            self._taken[caller] -= 1
            if not self._taken[caller]:
                del self._taken[caller]
