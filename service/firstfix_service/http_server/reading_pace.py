"""Pace at which the caller of a connection takes its answers in."""

from __future__ import annotations

MIN_BYTES_PER_S = 500  # of a body, and of an answer: the slowest mobile networks are faster
LONGEST_ANSWER_S = 300.0  # for a long answer to be taken in: its bytes stay in memory until then


class ReadingPace:
    """Measures the caller of one answer after the other.

    Only the time during which writing is paused counts: otherwise the service has nothing to send. A pause of
    its own for each piece of an answer would not do, because a caller may take one piece in, and stop again.

    Args:
        answer_s: seconds that a caller may wait with any answer.
    """

    def __init__(self, answer_s: float) -> None:
        self._answer_s = answer_s
        self._bytes_per_s = float(MIN_BYTES_PER_S)
        self._written_bytes = 0
        self._waited_s = 0.0  # in the pauses that have ended
        self._paused_at: float | None = None

    @property
    def is_paused(self) -> bool:
        """True if the service waits for the caller to take something in."""
        return self._paused_at is not None

    def begin(self, size_bytes: int, unsent_bytes: int) -> None:
        """Begins an answer.

        Args:
            size_bytes: of its body; 0: not known.
            unsent_bytes: that the transport still has to send, of this and earlier answers.
        """
        self._bytes_per_s = max(MIN_BYTES_PER_S, size_bytes / LONGEST_ANSWER_S)
        self._written_bytes = unsent_bytes
        self._waited_s = 0.0

    def wrote(self, count: int) -> None:
        """Counts bytes that were given to the transport."""
        self._written_bytes += count

    def paused(self, now: float) -> None:
        """Notes that the transport takes no more, because the caller takes in too little."""
        if self._paused_at is None:
            self._paused_at = now

    def resumed(self, now: float) -> None:
        """Notes that the transport takes more."""
        if self._paused_at is not None:
            self._waited_s += now - self._paused_at
            self._paused_at = None

    def is_too_slow(self, now: float, unsent_bytes: int) -> bool:
        """Returns whether the caller has taken in too little for the time that it had.

        Args:
            unsent_bytes: that the transport still has to send.
        """
        waited_s = self._waited_s + (0.0 if self._paused_at is None else now - self._paused_at)
        taken_bytes = max(0, self._written_bytes - unsent_bytes)
        return waited_s > self._answer_s + taken_bytes / self._bytes_per_s
