"""When a query must be answered, and whether anybody still waits for its answer."""

from __future__ import annotations

import math
import time

import numpy as np

from .. import native
from ..errors import QueryCancelled


class Deadline:
    """A time, and a word of memory by which others cancel the query. Thread-safe.

    A step of the search that would end after the time does not begin, and the answer is the best one so far.
    A cancelled query has no answer: the engine looks at the word before each pose that it aligns.

    Args:
        at: of ``time.monotonic``; inf: none.
        word: eight bytes, aligned, which another process may write; None: a word of its own.
        number: of the query, not 0. The query is cancelled while the word holds it. Queries that come one
            after the other may share a word: a late cancellation ends none of them but its own.

    Attributes:
        at: as given.
        cancellation: for the compiled search.
    """

    def __init__(self, at: float = math.inf, word: memoryview | None = None, number: int = 1) -> None:
        self.at = at
        self._word = memoryview(bytearray(8) if word is None else word).cast("B").cast("Q")
        self._number = number
        self.cancellation = native.Cancellation(np.frombuffer(self._word, np.uint64), number)

    @property
    def left_s(self) -> float:
        """Seconds until the time; negative after it."""
        return self.at - time.monotonic()

    def cancel(self) -> None:
        """Let the query end without an answer, within some milliseconds."""
        self._word[0] = self._number

    def check_wanted(self) -> None:
        """Check that the query is not cancelled.

        Raises:
            QueryCancelled: it is.
        """
        if self._word[0] == self._number:
            raise QueryCancelled("nobody waits for the answer any more")
