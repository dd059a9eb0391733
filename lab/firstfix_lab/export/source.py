"""Sources of a map and its kept queries: a service, or its store."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_POINTS
from firstfix.catalog.recorded_queries import QuerySample, QuerySamples
from firstfix.errors import InvalidOption, NotFound
from firstfix_builder.index.cloud_octree import POINT

if TYPE_CHECKING:
    from firstfix.catalog.catalog import Catalog
    from firstfix_cli.viewer_client import ViewerClient

MAX_INDEX_BYTES = 64 << 20


class ExportSource(Protocol):
    """One map with its kept queries. Both implementations return the same."""

    def active_version(self) -> str:
        """The version that answers.

        Raises:
            NotFound: no such map, or no version of it is active.
        """

    def cloud(self, version: str) -> dict[str, Any] | None:
        """The index of a version's cloud for viewers; None if the version has none.

        Raises:
            NotFound: no such version.
        """

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        """Some of the cloud's points, packed."""

    def samples(self) -> Iterator[QuerySample]:
        """Yield the kept queries about the map, newest first."""

    def body(self, sample_id: str) -> bytes:
        """The body of a kept query as it came.

        Raises:
            NotFound: it was removed meanwhile.
        """


@contextmanager
def export_source(
    map_id: str, *, url: str | None, store: str | None, samples: str | None = None
) -> Iterator[ExportSource]:
    """Give the map at the service, or with ``store`` in its store.

    Args:
        samples: store of the kept queries, if it is another one than ``store``.

    Raises:
        InvalidOption: a service and a store are given, or ``samples`` without ``store``.
    """
    if url is not None and store is not None:
        raise InvalidOption("give only one of --url and --store")
    if samples is not None and store is None:
        raise InvalidOption("--samples needs --store")
    if store is None:
        from firstfix_cli.viewer_client import ViewerClient

        client = ViewerClient.at(url)
        with client:
            yield _ServiceMap(client, map_id)
        return
    from firstfix.catalog.catalog import Catalog
    from firstfix.store.store import Store

    opened = Store.open(store, read_only=True)
    kept = opened if samples is None else Store.open(samples, read_only=True)
    yield _StoredMap(Catalog(opened), QuerySamples(kept), map_id)


class _ServiceMap:
    def __init__(self, client: ViewerClient, map_id: str) -> None:
        self._client = client
        self._map_id = map_id

    def active_version(self) -> str:
        version = self._client.show_map(self._map_id).active_version
        if version is None:
            raise NotFound(f"map {self._map_id} has no active version")
        return version

    def cloud(self, version: str) -> dict[str, Any] | None:
        try:
            return dict(self._client.cloud(self._map_id, version))
        except NotFound:
            if version in {entry.version for entry in self._client.versions(self._map_id)}:
                return None
            raise

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        return self._client.cloud_points(self._map_id, version, first, count)

    def samples(self) -> Iterator[QuerySample]:
        return self._client.samples(self._map_id)

    def body(self, sample_id: str) -> bytes:
        return self._client.sample_body(sample_id)


class _StoredMap:
    def __init__(self, catalog: Catalog, samples: QuerySamples, map_id: str) -> None:
        self._catalog = catalog
        self._samples = samples
        self._map_id = map_id

    def active_version(self) -> str:
        version = self._catalog.active_version(self._map_id)
        if version is None:
            raise NotFound(f"the store has no map {self._map_id}, or it has no active version")
        return version

    def cloud(self, version: str) -> dict[str, Any] | None:
        if CLOUD_INDEX not in self._catalog.manifest(self._map_id, version).files:
            return None
        data = self._catalog.read_file(self._map_id, version, CLOUD_INDEX, max_bytes=MAX_INDEX_BYTES)
        return dict(json.loads(data))

    def cloud_points(self, version: str, first: int, count: int) -> bytes:
        start, length = first * POINT.itemsize, count * POINT.itemsize
        return self._catalog.read_part(self._map_id, version, CLOUD_POINTS, start, length)

    def samples(self) -> Iterator[QuerySample]:
        for sample_id in reversed(self._samples.ids()):
            sample = self._samples.find(sample_id)
            if sample is not None and sample.is_about(self._map_id):
                yield sample

    def body(self, sample_id: str) -> bytes:
        return self._samples.body(sample_id)
