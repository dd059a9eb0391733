"""Answers to queries: from a service over HTTP or zenoh, or from the engine in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption, NotFound
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan, ScanSequence

from .arguments import PATIENCE_S, cache_directory, client_of

if TYPE_CHECKING:
    from firstfix_client import Client, ZenohClient
    from firstfix_client.steps.scan_body import Encoding

Answerer = Callable[[Scan | ScanSequence, LocalizeOptions], Localization]


@contextmanager
def answerer(
    map_id: str,
    *,
    url: str | None,
    zenoh: str | None,
    store: str | None,
    timeout_s: float,
    encoding: Encoding = "scan",
    follow: Callable[[str], None] | None = None,
) -> Iterator[Answerer]:
    """Give a function that localizes a scan, with the URL, the zenoh endpoint or the store.

    Args:
        encoding: form in which scans are sent; in this process they are encoded and decoded too.
        follow: with a store, new versions are loaded in the background, and the cache answers while the
            store does not. It is called with a line about each change. None: what is loaded once stays.

    Raises:
        InvalidOption: more than one of the three is given.
        NotFound: no such map.
    """
    if sum(way is not None for way in (url, zenoh, store)) > 1:
        raise InvalidOption("give only one of --url, --zenoh and --store")
    if store is not None and follow is not None:
        with _embedded(map_id, store, follow) as embedded:
            yield _naming_times(embedded)
    elif store is not None:
        yield _naming_times(_in_process(map_id, store, encoding))
    elif zenoh is not None:
        from firstfix_client import RetryPolicy, ZenohClient

        retry = RetryPolicy(patience_s=PATIENCE_S)
        with ZenohClient(zenoh, timeout_s=timeout_s, retry=retry) as zenoh_client:
            yield _AskedService(zenoh_client, map_id, encoding)
    else:
        with client_of(url, timeout_s) as client:
            yield _AskedService(client, map_id, encoding)


@dataclass(frozen=True)
class _AskedService:
    """Answers of a service about one map, in a robot's name where there are several."""

    client: Client | ZenohClient
    map_id: str
    encoding: Encoding
    robot: str | None = None

    def __call__(self, scan: Scan | ScanSequence, options: LocalizeOptions) -> Localization:
        return _naming_times(self._ask)(scan, options)

    def of_robot(self, name: str) -> _AskedService:
        return replace(self, robot=name)

    def _ask(self, scan: Scan | ScanSequence, options: LocalizeOptions) -> Localization:
        return self.client.localize(
            scan, map_id=self.map_id, options=options, encoding=self.encoding, robot=self.robot
        )


def _naming_times(ask: Answerer) -> Answerer:
    """Also name a field of the scan that was not understood as times: what is sent no longer has it."""
    from firstfix.answer.time_findings import with_time_field

    def answer(scan: Scan | ScanSequence, options: LocalizeOptions) -> Localization:
        last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
        return with_time_field(ask(scan, options), last)

    return answer


def is_provisional(store: str, map_id: str, version: str) -> bool:
    """Whether a version is coarse and little tested, until a full one takes its place."""
    from firstfix.catalog.catalog import Catalog

    from .stores import existing_store

    return version in Catalog(existing_store(store)).state(map_id).provisional


def fetch_active_version(store: str, map_id: str, version: str | None = None) -> tuple[str, Path]:
    """Digest and local folder of a map's version, by default the active one.

    Args:
        version: or its first characters.

    Raises:
        NotFound: no such map or version.
        InvalidOption: several versions begin so.
    """
    from firstfix.catalog.catalog import Catalog
    from firstfix.catalog.nearest_map import with_nearest

    from .stores import existing_store

    catalog = Catalog(existing_store(store))
    try:
        chosen = catalog.full_version(map_id, version) if version else catalog.active_version(map_id)
    except NotFound as error:
        raise with_nearest(error, catalog.folder_names) from None
    if chosen is None:
        if catalog.state(map_id).exists:
            raise NotFound(f"map {map_id} has no active version")
        raise with_nearest(NotFound.of_map(map_id), catalog.folder_names)
    return chosen, catalog.fetch_version(map_id, chosen, cache_directory("versions"))


@contextmanager
def _embedded(map_id: str, store: str, log_line: Callable[[str], None]) -> Iterator[Answerer]:
    from firstfix.catalog.catalog import Catalog
    from firstfix.catalog.versions.last_served import LastServed
    from firstfix.store.store import Store

    from .embedded import EmbeddedLocalizer

    last = LastServed(cache_directory("last-served"), store, map_id)
    catalog = Catalog(Store.open(store, read_only=True))
    localizer = EmbeddedLocalizer(catalog, map_id, cache_directory("versions"), last, log_line=log_line)
    try:
        localizer.start()
        yield localizer
    finally:
        localizer.close()


def _in_process(map_id: str, store: str, encoding: Encoding) -> Answerer:
    from firstfix.decode import decode_query
    from firstfix.engine.index import MapIndex
    from firstfix.engine.localizer import Localizer
    from firstfix.scan.descriptor_parameters import DescriptorParameters
    from firstfix_client.steps.scan_body import BodyForm, encoded

    loaded: dict[str | None, tuple[str, Localizer, bool]] = {}

    def answer(scan: Scan | ScanSequence, options: LocalizeOptions) -> Localization:
        if options.version not in loaded:
            version, directory = fetch_active_version(store, map_id, options.version)
            localizer = Localizer(MapIndex.load(directory))
            loaded[options.version] = version, localizer, is_provisional(store, map_id, version)
        version, localizer, provisional = loaded[options.version]
        query: AnyScan = scan
        if encoding != "scan":
            described = encoding == "descriptor"
            engine = localizer.index.config.model_dump()
            form = BodyForm(encoding, DescriptorParameters.from_engine(engine) if described else None)
            media_type, body = encoded(scan, form, options.gravity)
            query = decode_query(body, media_type)
        found = localizer.localize(query, options)
        return found.of_version(map_id, version, provisional=provisional)

    return answer
