"""Live replicas, from their zenoh liveliness tokens."""

from __future__ import annotations

import threading
from typing import Any

FIRST_LOOK_S = 1.0


class LiveReplicas:
    """Live replicas for each key that was asked for, updated by their tokens. Thread-safe."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self._keys: dict[str, set[str]] = {}
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

    def _watch(self, pattern: str) -> set[str]:
        replies = self._session.liveliness().get(pattern, timeout=FIRST_LOOK_S)
        keys = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

        def changed(sample: Any) -> None:
            with self._changing:
                if str(sample.kind).endswith("DELETE"):
                    keys.discard(str(sample.key_expr))
                else:
                    keys.add(str(sample.key_expr))

        # history: also reports replicas that came or went since the first look
        subscriber = self._session.liveliness().declare_subscriber(pattern, changed, history=True)
        self._subscribers.append(subscriber)
        return keys
