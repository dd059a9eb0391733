"""Thread that polls the catalog, so that the served versions follow it."""

from __future__ import annotations

import threading
from collections.abc import Callable

import structlog

from firstfix.errors import FirstfixError

from .map_cache import MapCache

_log = structlog.get_logger(__name__)


class MapPoller:
    """Calls ``MapCache.poll`` in a thread, every ``interval_s``.

    Args:
        after: called after every poll that succeeded.
        failed: called with the error of every poll that failed.
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
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and waits until it has ended."""
        self._stop.set()
        self._maps.stop_prefetch()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._maps.poll()
                self._after()
            except FirstfixError as error:  # loaded versions go on answering
                self._failed(error)
                _log.warning("cannot read the catalog", code=error.code, error=str(error))
            except (
                Exception
            ) as error:  # the poller must survive a defect: without it no new version is served
                self._failed(error)
                _log.exception("the poll failed")
            self._stop.wait(self._interval_s)
