"""Look-up of a key that the last listing did not have: it may have been made since.

A stranger can invent keys. So each unknown key is looked up once between two listings, and the look-ups of
one address and of all callers are few: whoever is over that is refused as before, and a new key then waits
for the next listing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firstfix.errors import RateLimited

from ..limits.limits import Limits
from ..limits.rate import Rate
from ..thread_pools import KEYS
from .key_ring import KeyRing

_ALL = ""  # name of all callers together
AT_ONCE = 4  # under way: more would hold up the listing of the keys, where the store is slow
WITHIN_S = 2.0  # then the caller is refused, and the look-up goes on for the next request


class NewKeys:
    """Looks up new keys within limits. For use by one event loop.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, keys: KeyRing, limits: Limits, clock: Callable[[], float]) -> None:
        self._keys = keys
        self._of_address = Rate("new keys", limits.new_keys_per_s, limits.new_keys_burst, clock=clock)
        self._of_all = Rate("new keys", limits.all_new_keys_per_s, limits.all_new_keys_burst, clock=clock)
        self._asked: dict[str, asyncio.Task[None]] = {}  # since the last listing
        self._listing = keys.listing

    async def look_up(self, key_id: str, address: str) -> None:
        """Look a key up in the store, unless it is known or was looked up since the last listing.

        Afterwards the ring of keys knows it, if there is such a key. Concurrent calls share one look-up.

        Args:
            address: of the caller.
        """
        if self._keys.knows(key_id):
            return
        if self._listing != self._keys.listing:
            self._listing = self._keys.listing
            self._asked = {asked: task for asked, task in self._asked.items() if not task.done()}
        task = self._asked.get(key_id)
        if task is None:
            if sum(not one.done() for one in self._asked.values()) >= AT_ONCE:
                return
            try:
                self._of_address.take(address)
                self._of_all.take(_ALL)
            except RateLimited:
                return
            task = self._asked[key_id] = asyncio.create_task(KEYS.run(self._keys.learn, key_id))
        if not task.done():
            await asyncio.wait({task}, timeout=WITHIN_S)
