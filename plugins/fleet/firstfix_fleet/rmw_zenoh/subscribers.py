"""The subscriptions that hear a publisher, as their liveliness tokens tell."""

from __future__ import annotations

import threading
from typing import Any

import zenoh

from firstfix.ros.rmw_zenoh import Endpoint, subscriptions_pattern


class Subscribers:
    """Counts the subscriptions that hear one publisher. Thread-safe.

    Args:
        session: zenoh session at the robots' router.
    """

    def __init__(self, session: Any, publisher: Endpoint) -> None:
        self._lock = threading.Lock()
        self._tokens: set[str] = set()
        self._listener = session.liveliness().declare_subscriber(
            subscriptions_pattern(publisher), self._on_token, history=True
        )

    def count(self) -> int:
        """How many there are."""
        with self._lock:
            return len(self._tokens)

    def close(self) -> None:
        """Ends counting."""
        self._listener.undeclare()

    def _on_token(self, sample: Any) -> None:
        with self._lock:
            if sample.kind == zenoh.SampleKind.DELETE:
                self._tokens.discard(str(sample.key_expr))
            else:
                self._tokens.add(str(sample.key_expr))
