"""Readiness of the service, and the reason if it is not ready."""

from __future__ import annotations

import time
from typing import Any

from firstfix.errors import FirstfixError

from ..builds.queue import BuildQueue
from ..localize.query_gate import QueryGate
from ..maps.map_cache import MapCache
from ..telemetry.metrics import Metrics


class HealthCheck:
    """State behind readiness. The poller reports each read of the catalog. Thread-safe.

    Args:
        builds: None: this service runs none.
    """

    def __init__(
        self, maps: MapCache, gate: QueryGate, metrics: Metrics, builds: BuildQueue | None = None
    ) -> None:
        self._maps = maps
        self._gate = gate
        self._builds = builds
        self._read_at: float | None = None  # time.monotonic
        self._error: str | None = None
        self._started = time.monotonic()
        metrics.catalog_age.set_function(self.catalog_age_s)

    def catalog_read(self) -> None:
        """Record that the catalog was read."""
        self._read_at, self._error = time.monotonic(), None

    def catalog_failed(self, error: BaseException) -> None:
        """Record a failed read. Only the error's code is shown: its text may name hosts and paths."""
        self._error = error.code if isinstance(error, FirstfixError) else FirstfixError.code

    def catalog_age_s(self) -> float:
        """The seconds since the catalog was read, or since the start if it never was."""
        return time.monotonic() - (self._started if self._read_at is None else self._read_at)

    def why_not_ready(self) -> str | None:
        """The reason, or None if the service is ready.

        It stays ready when the store fails later: loaded maps go on answering.
        """
        if self._maps.polled:
            return None
        if self._error is not None:
            return f"the catalog cannot be read: {self._error}"
        return "the maps are being loaded"

    def details(self) -> dict[str, Any]:
        """The details of /readyz, for people: faults that do not stop queries."""
        placement = self._maps.placement
        return {
            "maps": len(self._maps.served),
            "holding": None if placement is None else placement.summary(self._maps.held_loaded),
            "catalog": {"age_s": round(self.catalog_age_s(), 1), "error": self._error},
            "queries": self._gate.admitted,
            "builds_wait_for": None if self._builds is None else self._builds.waits_for,
        }
