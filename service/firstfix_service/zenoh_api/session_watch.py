"""Watch of a zenoh session: how many are connected with it, and whether it still answers at all."""

from __future__ import annotations

import threading
from typing import Any

import structlog
import zenoh

from ..telemetry.stall_watch import Pulse

_log = structlog.get_logger(__name__)
PERIOD_S = 1.0


class SessionWatch:
    """Asks the session for its connections, in a thread of its own.

    A lock of a connection whose peer is frozen can stay taken for good. Whoever then asks for it hangs: this
    thread, whose pulse the watchdog sees, and nobody else.

    Attributes:
        connections: routers, peers and clients connected, when last asked.
    """

    def __init__(self, session: Any, pulse: Pulse) -> None:
        self.connections = 0
        self._session = session
        self._pulse = pulse
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the watch. Does not wait for it."""
        self._stop.set()
        self.connections = 0

    def _run(self) -> None:
        while True:
            try:
                with self._pulse.call():
                    connections = len(self._session.info.transports())
            except zenoh.ZError as error:
                _log.warning("zenoh does not say who is connected", error=str(error))
            else:
                if not self._stop.is_set():
                    self.connections = connections
            if self._stop.wait(PERIOD_S):
                return
