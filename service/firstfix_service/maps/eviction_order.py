"""Order in which versions are evicted from memory: least recently used first, protected versions last."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Generic, Protocol, TypeVar

Key = tuple[str, str]  # map id, version


class Sized(Protocol):
    """An item with a size in bytes."""

    @property
    def bytes(self) -> int:
        """Size in memory."""


Item = TypeVar("Item", bound=Sized)


class EvictionOrder(Generic[Item]):
    """Versions by key, in the order of eviction. Not thread-safe.

    Every call except ``reclassify`` takes constant time.

    Args:
        is_protected: whether a version is evicted only after all unprotected ones. It is called when a
            version is added or used, and by ``reclassify``.
    """

    def __init__(self, is_protected: Callable[[Key], bool]) -> None:
        self._is_protected = is_protected
        self._unprotected: OrderedDict[Key, Item] = OrderedDict()
        self._protected: OrderedDict[Key, Item] = OrderedDict()
        self.bytes = 0
        self.protected_bytes = 0

    def __len__(self) -> int:
        return len(self._unprotected) + len(self._protected)

    def __contains__(self, key: Key) -> bool:
        return key in self._unprotected or key in self._protected

    def __iter__(self) -> Iterator[Key]:
        """Iterates over the keys; the first one is evicted first."""
        return chain(self._unprotected, self._protected)

    @property
    def protected(self) -> int:
        """Number of protected versions."""
        return len(self._protected)

    def add(self, key: Key, item: Item) -> None:
        """Adds a version at the end of its class."""
        self.bytes += item.bytes
        if self._is_protected(key):
            self._protected[key] = item
            self.protected_bytes += item.bytes
        else:
            self._unprotected[key] = item

    def use(self, key: Key) -> Item | None:
        """Returns a version and moves it to the end of its class; None if it is not here."""
        if key not in self:
            return None
        item = self.pop(key)
        self.add(key, item)
        return item

    def pop(self, key: Key) -> Item:
        """Removes a version and returns it."""
        if key in self._unprotected:
            item = self._unprotected.pop(key)
        else:
            item = self._protected.pop(key)
            self.protected_bytes -= item.bytes
        self.bytes -= item.bytes
        return item

    def reclassify(self) -> None:
        """Asks again which versions are protected.

        Within its class each version keeps its place. A version that is no longer protected goes to the end
        of the unprotected ones.
        """
        for key in [key for key in self._protected if not self._is_protected(key)]:
            self.add(key, self.pop(key))
        for key in [key for key in self._unprotected if self._is_protected(key)]:
            self.add(key, self.pop(key))
