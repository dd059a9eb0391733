"""Keeps the served versions in step with the catalog, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable

import structlog

from firstfix.errors import FirstfixError

from .map_cache import MapCache

_log = structlog.get_logger(__name__)


class MapPoller:
    """Calls ``MapCache.poll`` now and then.

    Args:
        after: called after every poll that succeeded.
        failed: called with the error of every other one.
    """

    def __init__(
        self,
        maps: MapCache,
        interval_s: float,
        after: Callable[[], None] = lambda: None,
        failed: Callable[[Exception], None] = lambda error: None,
    ) -> None:
        self._maps = maps
        self._interval_s = interval_s
        self._after = after
        self._failed = failed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="map-poller", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._maps.load_no_more()
        self._thread.join(timeout=30)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._maps.poll()
                self._after()
            except FirstfixError as error:  # what is loaded goes on answering
                self._failed(error)
                _log.warning("cannot read the catalog", code=error.code, error=str(error))
            except Exception as error:  # the poller must outlive a defect: without it nothing new is served
                self._failed(error)
                _log.exception("the poll failed")
            self._stop.wait(self._interval_s)
