"""Thread that shows changes of the maps in zenoh: tokens, keys and publications.

The poll of the catalog only wakes it. So the maps go on following the store while zenoh hangs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import structlog

from ..telemetry.stall_watch import Pulse

_log = structlog.get_logger(__name__)
RETRY_S = 3.0


class ZenohUpdates:
    """Runs ``update`` after each ``wake``, once for several of them, and again after it has failed.

    Args:
        update: gets a function to call before each call of zenoh.
    """

    def __init__(self, update: Callable[[Callable[[], None]], None], pulse: Pulse) -> None:
        self._update = update
        self._pulse = pulse
        self._woken = threading.Event()
        self._is_closed = False
        threading.Thread(target=self._run, name="zenoh-updates", daemon=True).start()

    def wake(self) -> None:
        """Lets the thread run ``update`` soon. Never blocks."""
        self._woken.set()

    def close(self) -> None:
        """Begins no more updates. Does not wait for one that runs."""
        self._is_closed = True
        self._woken.set()

    def _run(self) -> None:
        timeout_s: float | None = None
        while True:
            self._woken.wait(timeout_s)
            self._woken.clear()
            if self._is_closed:
                return
            try:
                with self._pulse.call():
                    self._update(self._pulse.begin)
                timeout_s = None
            except Exception:  # a defect must not end the thread: no map would be shown any more
                _log.exception("maps were not shown in zenoh")
                timeout_s = RETRY_S
