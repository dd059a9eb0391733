"""Threads for calls of zenoh, any of which may hang: it waits for locks that a frozen peer can keep taken.

No such call runs on the event loop. These threads are daemons, so that none of them keeps the process from
ending, as the threads of an executor would.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, ParamSpec, TypeVar

import structlog
import zenoh

from firstfix.wire.endpoints import said_by_zenoh

from ..telemetry.stall_watch import Pulse

_log = structlog.get_logger(__name__)
PERIOD_S = 1.0  # of the session's watch
RETRY_S = 3.0  # of an update that failed
P = ParamSpec("P")
T = TypeVar("T")


def connected_with(session: Any) -> set[str]:
    """The zenoh ids of the routers, peers and clients connected with a session.

    It may wait for a lock that a frozen peer keeps taken, but without the interpreter's lock. The call
    ``info.transports()`` waits with it: then no thread of the process goes on, not even the watchdog.
    """
    return {str(link.zid) for link in session.info.links()}


async def in_zenoh_thread(work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """Run work in a thread of its own and return its result. Work that has begun is not cancelled."""
    done: Future[T] = Future()

    def run() -> None:
        try:
            result = work(*args, **kwargs)
        except BaseException as error:
            done.set_exception(error)
        else:
            done.set_result(result)

    done.set_running_or_notify_cancel()
    threading.Thread(target=run, name="zenoh-call", daemon=True).start()
    return await asyncio.wrap_future(done)


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
        """End the watch. Does not wait for it."""
        self._stop.set()
        self.connections = 0

    def _run(self) -> None:
        while True:
            try:
                with self._pulse.call():
                    connections = len(connected_with(self._session))
            except zenoh.ZError as error:
                _log.warning("zenoh does not say who is connected", error=said_by_zenoh(error))
            else:
                if not self._stop.is_set():
                    self.connections = connections
            if self._stop.wait(PERIOD_S):
                return


class ZenohUpdates:
    """Runs ``update`` after each ``wake``, once for several of them, and again after it has failed.

    It shows changes of the maps in zenoh: tokens, keys and publications. The poll of the catalog only wakes
    it. So the maps go on following the store while zenoh hangs.

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
        """Let the thread run ``update`` soon. Never blocks."""
        self._woken.set()

    def close(self) -> None:
        """Begin no more updates. Does not wait for one that runs."""
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
