"""The order in which versions leave the memory: those used longest ago first, but before those that this
replica keeps all others."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Generic, Protocol, TypeVar

Key = tuple[str, str]  # map id, version


class Sized(Protocol):
    @property
    def bytes(self) -> int: ...


Item = TypeVar("Item", bound=Sized)


class LeavingOrder(Generic[Item]):
    """Versions by key. Not thread-safe. No call but ``sort_again`` takes longer with more of them.

    Args:
        keeps: whether a version goes after all those that are not kept; asked when it comes, when it is
            used, and by ``sort_again``.
    """

    def __init__(self, keeps: Callable[[Key], bool]) -> None:
        self._keeps = keeps
        self._guests: OrderedDict[Key, Item] = OrderedDict()
        self._kept: OrderedDict[Key, Item] = OrderedDict()
        self.bytes = 0
        self.kept_bytes = 0

    def __len__(self) -> int:
        return len(self._guests) + len(self._kept)

    def __contains__(self, key: Key) -> bool:
        return key in self._guests or key in self._kept

    def __iter__(self) -> Iterator[Key]:
        """The first to leave first."""
        return chain(self._guests, self._kept)

    @property
    def kept(self) -> int:
        """How many of them are kept."""
        return len(self._kept)

    def add(self, key: Key, item: Item) -> None:
        self.bytes += item.bytes
        if self._keeps(key):
            self._kept[key] = item
            self.kept_bytes += item.bytes
        else:
            self._guests[key] = item

    def use(self, key: Key) -> Item | None:
        """The version, which is now the last of its kind to leave; None: it is not here."""
        if key not in self:
            return None
        item = self.pop(key)
        self.add(key, item)
        return item

    def pop(self, key: Key) -> Item:
        if key in self._guests:
            item = self._guests.pop(key)
        else:
            item = self._kept.pop(key)
            self.kept_bytes -= item.bytes
        self.bytes -= item.bytes
        return item

    def sort_again(self) -> None:
        """After what is kept has changed. Among its kind each stays in its place; what is no longer kept
        leaves after the other guests."""
        for key in [key for key in self._kept if not self._keeps(key)]:
            self.add(key, self.pop(key))
        for key in [key for key in self._guests if self._keeps(key)]:
            self.add(key, self.pop(key))
