"""A bounded number of long requests at a time, of one caller and of all; the next one is told so at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from firstfix.errors import Overloaded, QuotaExceeded


class Places:
    """Counts what is under way. One event loop's.

    Args:
        limit: of all callers together.
        per_caller: of one caller: the others' places are not his to take.
        what: for people: what there are too many of.
    """

    def __init__(self, limit: int, per_caller: int, what: str) -> None:
        self._limit = limit
        self._per_caller = per_caller
        self._what = what
        self._taken: Counter[str] = Counter()

    @property
    def taken(self) -> int:
        return self._taken.total()

    @contextmanager
    def one(self, caller: str) -> Iterator[None]:
        """
        Raises:
            QuotaExceeded: the caller has as many as one may have.
            Overloaded: all are taken.
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
