"""Whether queries should be sent here, and why not."""

from __future__ import annotations

import time
from typing import Any

from firstfix.errors import FirstfixError

from ..localize.pool import QueryPool
from ..maps.map_cache import MapCache
from ..telemetry.metrics import Metrics


class Health:
    """What readiness stands on. The poller tells it how reading the catalog went. Thread-safe."""

    def __init__(self, maps: MapCache, pool: QueryPool, metrics: Metrics) -> None:
        self._maps = maps
        self._pool = pool
        self._read_at: float | None = None  # time.monotonic
        self._error: str | None = None
        self._started = time.monotonic()
        metrics.catalog_age.set_function(self.catalog_age_s)

    def catalog_read(self) -> None:
        self._read_at, self._error = time.monotonic(), None

    def catalog_failed(self, error: BaseException) -> None:
        """Its code is shown, not its text: that may name hosts and paths."""
        self._error = error.code if isinstance(error, FirstfixError) else FirstfixError.code

    def catalog_age_s(self) -> float:
        """Since the catalog was read; while it never was, since the start."""
        return time.monotonic() - (self._started if self._read_at is None else self._read_at)

    def why_not_ready(self) -> str | None:
        """None: it is. Once ready it stays so when the store fails: what is loaded goes on answering."""
        if self._maps.polled:
            return None
        if self._error is not None:
            return f"the catalog cannot be read: {self._error}"
        return "the maps are being loaded"

    def details(self) -> dict[str, Any]:
        """For people who look: what is wrong although queries are answered."""
        placement = self._maps.placement
        return {
            "maps": len(self._maps.served),
            "holding": None if placement is None else placement.summary(self._maps.held_loaded),
            "catalog": {"age_s": round(self.catalog_age_s(), 1), "error": self._error},
            "queries": self._pool.admitted,
        }
