"""The lines of a large text by their numbers, without a string for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class TextLines:
    """Lines of a text, with empty ones at the end left out.

    Attributes:
        raw: the text.
    """

    def __init__(self, raw: bytes) -> None:
        self.raw = raw.rstrip()
        ends: NDArray[np.int64] = np.flatnonzero(np.frombuffer(self.raw, np.uint8) == ord("\n"))
        self._starts = np.concatenate([[0], ends + 1, [len(self.raw) + 1]])

    def __len__(self) -> int:
        return len(self._starts) - 1

    def words(self, number: int) -> list[str]:
        """Words of one line."""
        return self.span(number, 1).decode("latin-1").split()

    def span(self, first: int, count: int) -> bytes:
        """Some lines as they are. They must be there."""
        return self.raw[int(self._starts[first]) : int(self._starts[first + count]) - 1]
