"""Administration of builds, with a service or with the store itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

from firstfix.errors import NotFound
from firstfix_client import BuildStatus

from .administered import administered

if TYPE_CHECKING:
    from firstfix.catalog.catalog import Catalog

    from .operator_client import OperatorClient

POLL_S = 1.0


class BuildAdmin(Protocol):
    """Operations of ``firstfix builds``."""

    def builds(self, map_id: str | None, state: str | None, limit: int) -> list[BuildStatus]:
        """The recorded builds, newest first."""

    def details(self, build_id: str) -> dict[str, Any]:
        """One build with its stages and what it was asked for, as JSON."""

    def follow(self, build_id: str) -> Iterator[BuildStatus]:
        """Yield the build's status whenever it changes; the last one is final."""

    def cancel(self, build_id: str) -> None:
        """Ask a build to stop."""

    def log(self, build_id: str) -> str:
        """The end of the log of a build's processes."""


def build_admin(url: str | None, store: str | None) -> AbstractContextManager[BuildAdmin]:
    """Give the builds of the service, or with ``store`` those of the store.

    Raises:
        InvalidOption, NotFound: as ``administered``.
    """
    return administered(url, store, _ServiceBuilds, _StoreBuilds)


class _ServiceBuilds:
    def __init__(self, client: OperatorClient) -> None:
        self._client = client

    def builds(self, map_id: str | None, state: str | None, limit: int) -> list[BuildStatus]:
        return list(islice(self._client.builds(map_id=map_id, state=state), limit))

    def details(self, build_id: str) -> dict[str, Any]:
        return dict(self._client.build_details(build_id))

    def follow(self, build_id: str) -> Iterator[BuildStatus]:
        return self._client.build_events(build_id)

    def cancel(self, build_id: str) -> None:
        self._client.cancel_build(build_id)

    def log(self, build_id: str) -> str:
        return self._client.build_log(build_id)


class _StoreBuilds:
    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._records = catalog.builds

    def builds(self, map_id: str | None, state: str | None, limit: int) -> list[BuildStatus]:
        return list(islice(self._each(map_id, state), limit))

    def _each(self, map_id: str | None, state: str | None) -> Iterator[BuildStatus]:
        for build_id in reversed(self._records.ids()):
            try:
                status = self._records.shown_status(build_id)
            except NotFound:  # collected just now
                continue
            if map_id in (None, status["map_id"]) and state in (None, status["state"]):
                yield BuildStatus.from_mapping(build_id, status)

    def details(self, build_id: str) -> dict[str, Any]:
        return {"build_id": build_id, **self._records.details(build_id)}

    def follow(self, build_id: str) -> Iterator[BuildStatus]:
        told: BuildStatus | None = None
        while told is None or not told.is_final:
            status = BuildStatus.from_mapping(build_id, self._records.status(build_id))
            if status != told:
                yield status
            told = status
            if not status.is_final:
                time.sleep(POLL_S)

    def cancel(self, build_id: str) -> None:
        from firstfix_service.builds.queue import cancel_build

        cancel_build(self._catalog, build_id)

    def log(self, build_id: str) -> str:
        return self._records.log(build_id)
