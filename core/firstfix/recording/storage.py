"""One file of a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from typing import Protocol

from .messages import RawMessage, Topic


class Storage(Protocol):
    """An open file of messages. Any exception may come of a damaged one: see ``damage_named``.

    Attributes:
        topics: those that have messages.
        start_ns: no message is earlier.
        notes: what a user should know of the way it was read: a sentence each.
    """

    @property
    def topics(self) -> Sequence[Topic]: ...  # noqa: D102
    @property
    def start_ns(self) -> int: ...  # noqa: D102
    @property
    def notes(self) -> Sequence[str]: ...  # noqa: D102

    def messages(self, topics: Set[str], start_ns: int | None) -> Iterator[RawMessage]:
        """Yield the messages of these topics in the order of recording, from a time on."""

    def close(self) -> None:
        """Close the file."""
