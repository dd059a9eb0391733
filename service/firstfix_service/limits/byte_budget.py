"""Bytes in memory at the same time, of all callers and of each: bodies that arrive, and answers that wait."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from firstfix.errors import FirstfixError, Overloaded, QuotaExceeded

from .limits import Limits

RETRY_AFTER_S = 2.0


@dataclass(frozen=True)
class Owner:
    """One whose bytes are counted.

    Attributes:
        what: kind of owner, in the refusal.
        name: among those of its kind.
        part: of the budget that it may have: a whole number, 2 for half.
    """

    what: str
    name: str
    part: int


class ByteBudget:
    """Counts bytes: of each owner, and of all. Thread-safe.

    A lease of an owner that has no other one may be larger than the owner's part.

    Args:
        refusal: makes the error; gets the kind of the owner that has too much, or nothing for all together.
        kept: part of the budget that is left to small leases; 0: nothing is.
        is_strict: not even a lease alone may be larger than the budget.
    """

    def __init__(
        self,
        max_bytes: int,
        refusal: Callable[[str], FirstfixError],
        *,
        kept: int = 0,
        is_strict: bool = False,
    ) -> None:
        self._max_bytes = max_bytes
        self._refusal = refusal
        self._kept_bytes = max_bytes // kept if kept else 0
        self._is_strict = is_strict
        self._taken: dict[tuple[str, str], int] = {}
        self._lock = threading.Lock()
        self.bytes = 0

    @classmethod
    def of_bodies(cls, max_bytes: int) -> ByteBudget:
        """The budget of the bodies of queries."""
        return cls(max_bytes, _of_bodies, is_strict=True)

    @classmethod
    def of_answers(cls, max_bytes: int) -> ByteBudget:
        """The budget of large answers that wait to be read."""
        return cls(max_bytes, _of_answers, kept=8)

    def lease(self, *owners: Owner) -> Lease:
        """A lease without bytes."""
        return Lease(self, owners)

    def count(self, lease: Lease, owners: tuple[Owner, ...], more: int) -> None:
        """Count a lease with more bytes, for these owners. Raises the refusal: then it stays as it is."""
        size = lease.size + more
        with self._lock:
            for owner in owners:
                others = self._taken.get((owner.what, owner.name), 0) - (
                    lease.size if owner in lease.owners else 0
                )
                if others > 0 and others + size > self._max_bytes // owner.part:
                    raise self._refusal(owner.what)
            kept_bytes = 0 if size < Limits.small_answer_bytes else self._kept_bytes
            is_alone = self.bytes == lease.size and not self._is_strict
            if more and not is_alone and self.bytes + more > self._max_bytes - kept_bytes:
                raise self._refusal("")
            if owners is lease.owners:
                self._add(owners, more)
            else:
                self._add(lease.owners, -lease.size)
                self._add(owners, size)
            self.bytes += more

    def give_back(self, owners: tuple[Owner, ...], size: int) -> None:
        """End the count of so many bytes of these owners."""
        with self._lock:
            self._add(owners, -size)
            self.bytes -= size

    def _add(self, owners: tuple[Owner, ...], count: int) -> None:
        for owner in owners:
            name = owner.what, owner.name
            taken = self._taken.pop(name, 0) + count
            if taken:
                self._taken[name] = taken


class Lease:
    """The bytes of one body or answer.

    Attributes:
        size: in bytes.
        owners: for whom they count; nobody: it is not known yet.
    """

    def __init__(self, budget: ByteBudget, owners: tuple[Owner, ...]) -> None:
        self._budget = budget
        self.size = 0
        self.owners = owners

    def grow(self, count: int) -> None:
        """Count more bytes.

        Raises:
            QuotaExceeded, Overloaded: an owner, or all together, would have too many. They are not counted.
        """
        self._budget.count(self, self.owners, count)
        self.size += count

    def name(self, *owners: Owner) -> None:
        """Count all bytes for their owners.

        Raises:
            QuotaExceeded, Overloaded: an owner would have too many. They count as before.
        """
        self._budget.count(self, owners, 0)
        self.owners = owners

    def end(self) -> None:
        """End the count. A second call does nothing."""
        self._budget.give_back(self.owners, self.size)
        self.size = 0


@lru_cache(Limits.max_names)
def owners_of_body(caller: str) -> tuple[Owner, ...]:
    """The owner of a query's body, who has at most half of the budget; none if it is not known."""
    return (Owner("caller", caller, 2),) if caller else ()


def _of_bodies(what: str) -> FirstfixError:
    return Overloaded(
        f"too many bodies{f' of this {what}' if what else ''} arrive at the same time: try again"
    )


def _of_answers(what: str) -> FirstfixError:
    if what:
        text = f"too many bytes wait for this {what} to read them: read the earlier answers first"
        return QuotaExceeded(text, retry_after_s=RETRY_AFTER_S)
    return Overloaded("too many bytes wait for callers to read them: try again", retry_after_s=RETRY_AFTER_S)
