"""Sources of a map and its recorded queries: a service, or its store."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.catalog.version_prefix import full_version
from firstfix.catalog.viewer_cloud import MAX_INDEX_BYTES, POINT
from firstfix.errors import InvalidOption, NotFound

if TYPE_CHECKING:
    from firstfix.catalog.catalog import Catalog
    from firstfix_cli.viewer_client import ViewerClient


class ExportSource(Protocol):
    """One map with its recorded queries. Both implementations return the same."""

    def active_version(self) -> str:
        """The version that answers.

        Raises:
            NotFound: no such map, or no version of it is active.
        """

    def full_version(self, given: str) -> str:
        """The only version of the map that begins with the given characters.

        Raises:
            NotFound, InvalidOption: none or several do.
        """

    def cloud(self, version: str) -> dict[str, Any] | None:
        """The index of a version's cloud for viewers; None if the version has none.

        Raises:
            NotFound: no such version.
        """

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        """Some of the cloud's points, packed."""

    def cloud_intensity(self, version: str, first: int, count: int) -> bytes:
        """The intensity of some of the points, a byte each. The cloud's index tells whether there is any."""

    def recorded_queries(self) -> Iterator[RecordedQuery]:
        """Yield the recorded queries about the map, newest first."""

    def body(self, query_id: str) -> bytes:
        """The body of a recorded query as it came.

        Raises:
            NotFound: it was removed meanwhile.
        """


@contextmanager
def export_source(
    map_id: str, *, url: str | None, store: str | None, recorded: str | None = None
) -> Iterator[ExportSource]:
    """Give the map at the service, or with ``store`` in its store.

    Args:
        recorded: store of the recorded queries, if it is another one than ``store``.

    Raises:
        InvalidOption: a service and a store are given, or ``recorded`` without ``store``.
    """
    if url is not None and store is not None:
        raise InvalidOption("give only one of --url and --store")
    if recorded is not None and store is None:
        raise InvalidOption("--recorded needs --store")
    if store is None:
        from firstfix_cli.viewer_client import ViewerClient

        client = ViewerClient.at(url)
        with client:
            yield _ServiceMap(client, map_id)
        return
    from firstfix.catalog.catalog import Catalog
    from firstfix.store.store import Store

    opened = Store.open(store, read_only=True)
    kept = opened if recorded is None else Store.open(recorded, read_only=True)
    yield StoredMap(Catalog(opened), RecordedQueries(kept), map_id)


class _ServiceMap:
    def __init__(self, client: ViewerClient, map_id: str) -> None:
        self._client = client
        self._map_id = map_id

    def active_version(self) -> str:
        version = self._client.show_map(self._map_id).active_version
        if version is None:
            raise NotFound(f"map {self._map_id} has no active version")
        return version

    def full_version(self, given: str) -> str:
        return full_version(given, (entry.version for entry in self._client.versions(self._map_id)))

    def cloud(self, version: str) -> dict[str, Any] | None:
        try:
            return dict(self._client.cloud(self._map_id, version))
        except NotFound:
            if version in {entry.version for entry in self._client.versions(self._map_id)}:
                return None
            raise

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        return self._client.cloud_points(self._map_id, version, first, count)

    def cloud_intensity(self, version: str, first: int, count: int) -> bytes:
        return self._client.cloud_intensity(self._map_id, version, first, count)

    def recorded_queries(self) -> Iterator[RecordedQuery]:
        return self._client.recorded_queries(self._map_id)

    def body(self, query_id: str) -> bytes:
        return self._client.recorded_body(query_id)


class StoredMap:
    """A map in a store, with the queries that are recorded about it."""

    def __init__(self, catalog: Catalog, recorded_queries: RecordedQueries, map_id: str) -> None:
        self._catalog = catalog
        self._recorded_queries = recorded_queries
        self._map_id = map_id

    def active_version(self) -> str:
        """The version that answers."""
        version = self._catalog.active_version(self._map_id)
        if version is None:
            raise NotFound(f"the store has no map {self._map_id}, or it has no active version")
        return version

    def full_version(self, given: str) -> str:
        """The only version that begins so."""
        return self._catalog.full_version(self._map_id, given)

    def cloud(self, version: str) -> dict[str, Any] | None:
        """The index of a version's cloud; None if it has none."""
        if CLOUD_INDEX not in self._catalog.manifest(self._map_id, version).files:
            return None
        data = self._catalog.read_file(self._map_id, version, CLOUD_INDEX, max_bytes=MAX_INDEX_BYTES)
        return dict(json.loads(data))

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        """Some of the cloud's points, packed."""
        start, length = first * POINT.itemsize, count * POINT.itemsize
        return self._catalog.read_part(self._map_id, version, CLOUD_POINTS, start, length)

    def cloud_intensity(self, version: str, first: int, count: int) -> bytes:
        """The intensity of some of the points, a byte each."""
        return self._catalog.read_part(self._map_id, version, CLOUD_INTENSITY, first, count)

    def recorded_queries(self) -> Iterator[RecordedQuery]:
        """Yield the recorded queries about the map, newest first."""
        for query_id in reversed(self._recorded_queries.ids()):
            recorded = self._recorded_queries.find(query_id)
            if recorded is not None and recorded.is_about(self._map_id):
                yield recorded

    def body(self, query_id: str) -> bytes:
        """The body of a recorded query as it came."""
        return self._recorded_queries.body(query_id)
