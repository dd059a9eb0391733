"""Versions in memory, in the order in which they are evicted."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

from .version_files import Key, VersionFiles


@dataclass(eq=False)
class LoadedVersion:
    """A version in memory.

    Attributes:
        bytes: size of its files and of what the query workers hold in memory besides.
        leases: number of open leases.
        is_leaving: it was evicted: there are no new leases, and it is unloaded when the last one is closed.
    """

    files: VersionFiles
    bytes: int
    leases: int = 0
    is_leaving: bool = False


class EvictionOrder:
    """Versions by key, in the order of eviction. Not thread-safe.

    Every call except ``reclassify`` takes constant time.

    Args:
        is_protected: whether a version is evicted only after all unprotected ones. It is called when a
            version is added, and by ``reclassify``.
    """

    def __init__(self, is_protected: Callable[[Key], bool]) -> None:
        self._is_protected = is_protected
        self._unprotected: OrderedDict[Key, LoadedVersion] = OrderedDict()
        self._protected: OrderedDict[Key, LoadedVersion] = OrderedDict()
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

    def add(self, key: Key, item: LoadedVersion) -> None:
        """Add a version at the end of its class."""
        self.bytes += item.bytes
        if self._is_protected(key):
            self._protected[key] = item
            self.protected_bytes += item.bytes
        else:
            self._unprotected[key] = item

    def use(self, key: Key) -> LoadedVersion | None:
        """A version and moves it to the end of its class; None if it is not here."""
        for versions in (self._unprotected, self._protected):
            if key in versions:
                versions.move_to_end(key)
                return versions[key]
        return None

    def pop(self, key: Key) -> LoadedVersion:
        """Remove a version and return it."""
        if key in self._unprotected:
            item = self._unprotected.pop(key)
        else:
            item = self._protected.pop(key)
            self.protected_bytes -= item.bytes
        self.bytes -= item.bytes
        return item

    def reclassify(self) -> None:
        """Ask again which versions are protected.

        Within its class each version keeps its place. A version that is no longer protected goes to the end
        of the unprotected ones.
        """
        for key in [key for key in self._protected if not self._is_protected(key)]:
            self.add(key, self.pop(key))
        for key in [key for key in self._unprotected if self._is_protected(key)]:
            self.add(key, self.pop(key))
