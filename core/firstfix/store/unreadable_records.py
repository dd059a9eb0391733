"""Records of a store that could not be read, each reported once."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable

from ..errors import UnreadableRecord

_log = logging.getLogger(__name__)
_REMEMBERED = 10_000  # that were reported


class UnreadableRecords:
    """Records of a store that could not be read. Thread-safe.

    Each is reported once, and again if it was repaired in between.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[str, None] = OrderedDict()
        self._listeners: list[Callable[[UnreadableRecord], None]] = []
        self._lock = threading.Lock()

    def listen(self, listener: Callable[[UnreadableRecord], None]) -> None:
        """Call a function for every record that turns out unreadable from now on."""
        self._listeners.append(listener)

    def report(self, error: UnreadableRecord) -> None:
        """Log a record and call the listeners, unless it was reported before."""
        with self._lock:
            if error.key in self._known:
                return
            self._known[error.key] = None
            while len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
        _log.warning("unreadable %s: %s", error.kind, error)
        for listener in self._listeners:
            listener(error)

    def forget(self, key: str) -> None:
        """Note that a record can be read again."""
        if self._known:
            with self._lock:
                self._known.pop(key, None)
