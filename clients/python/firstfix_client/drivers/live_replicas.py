"""Live replicas, from their zenoh liveliness tokens."""

from __future__ import annotations

import threading
from typing import Any

from firstfix.ids import is_name

FIRST_LOOK_S = 1.0
MAX_REPLICAS = 1000  # of one key: anybody may declare tokens


class LiveReplicas:
    """Live replicas for each key that was asked for, updated by their tokens. Thread-safe.

    A token proves nothing. A signed reply does: ``proved`` remembers who gave one.
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._keys: dict[str, set[str]] = {}
        self._proved: set[str] = set()
        self._subscribers: list[Any] = []
        self._watching = threading.Lock()  # held during calls into zenoh
        self._changing = threading.Lock()  # taken by zenoh's callbacks, so never held over such calls

    def of(self, shared: str) -> list[str]:
        """Returns the keys ``{shared}/{replica}`` of live replicas, sorted."""
        with self._watching:
            if shared not in self._keys:
                self._keys[shared] = self._watch(f"{shared}/*")
        with self._changing:
            return sorted(self._keys[shared])

    def prove(self, key: str) -> None:
        """Records that the replica with this key has the secret that replies are signed with."""
        with self._changing:
            if any(key in keys for keys in self._keys.values()):
                self._proved.add(key)

    def is_proved(self, key: str) -> bool:
        """Returns whether the replica has given a signed reply since it is live."""
        return key in self._proved

    def _watch(self, pattern: str) -> set[str]:
        keys: set[str] = set()

        def add(key: str) -> None:
            if len(keys) < MAX_REPLICAS and is_name(key.rpartition("/")[2]):
                keys.add(key)

        def changed(sample: Any) -> None:
            key = str(sample.key_expr)
            with self._changing:
                if str(sample.kind).endswith("DELETE"):
                    keys.discard(key)
                    self._proved.discard(key)
                else:
                    add(key)

        for reply in self._session.liveliness().get(pattern, timeout=FIRST_LOOK_S):
            if reply.ok is not None:
                add(str(reply.ok.key_expr))
        # history: also reports replicas that came or went since the first look
        subscriber = self._session.liveliness().declare_subscriber(pattern, changed, history=True)
        self._subscribers.append(subscriber)
        return keys
