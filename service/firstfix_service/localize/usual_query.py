"""The usual query of a caller in a map: how long it takes, and how large its body is."""

from __future__ import annotations

from dataclasses import dataclass

_WEIGHT = 0.1  # of the newest query


@dataclass(frozen=True)
class UsualQuery:
    """Moving averages over the queries that ended.

    Attributes:
        seconds: time of the work.
        size_bytes: of the body.
    """

    seconds: float
    size_bytes: float

    @classmethod
    def after(cls, usual: UsualQuery | None, seconds: float, size_bytes: int) -> UsualQuery:
        """Returns the usual query after one more.

        Args:
            usual: before it; None: it is the first one.
        """
        if usual is None:
            return cls(seconds, size_bytes)
        return cls(_mean(usual.seconds, seconds), _mean(usual.size_bytes, size_bytes))

    def expected_s(self, size_bytes: int) -> float:
        """Returns the time that a query will take: as usual, and longer in proportion if it is larger."""
        return self.seconds * max(1.0, size_bytes / max(1.0, self.size_bytes))


def _mean(old: float, new: float) -> float:
    return old + _WEIGHT * (new - old)
