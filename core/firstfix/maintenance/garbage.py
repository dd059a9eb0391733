"""Garbage collection of a whole store: objects that nothing refers to any more.

    versions      files and sightings of retired versions, and of publications that never ended
    builds        records of builds that ended long ago and whose version is not served
    sources       sources that no recorded build refers to, apart from those that ended without a version
    uploads       uploads that were abandoned
    idempotency   keys of requests that nobody repeats any more
    logs          entries of maps' logs that are summed up in snapshots
    changes       notices of changes that all readers have read
    callers       usage of callers on past days, and builds that were never recorded
    leftovers     probes, part files and announcements of killed processes

A source is kept as long as the record of a build refers to it that waits, runs or made a version, and the
record as long as the build's version can be served: so what is served can always be built again. A damaged
record of a build stays, and so do all sources that are older than it, because nobody can tell which of them
it refers to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from ..builds.callers import CALLERS_FOLDER, IDEMPOTENCY_FOLDER
from ..builds.records import FINAL_STATES
from ..catalog.catalog import Catalog, log_folder
from ..catalog.log.log_garbage import change_garbage, log_garbage
from ..catalog.log.map_log import MapLog
from ..errors import InvalidOption, NotFound, UnreadableRecord
from ..ids import check_map_id, is_name
from ..store.json_record import read_each
from ..store.store import StoredObject
from .pending_deletions import FOLDER as PENDING_DELETIONS
from .pending_deletions import announce_deletion

DAY_S = 86400.0
USAGE_DAYS = 7  # after this a waiting build no longer counts for its caller


@dataclass(frozen=True)
class Ages:
    """Least ages of garbage in seconds.

    Attributes:
        things_s: of any object: a publication, an upload or a repeated request may be in progress.
        builds_s: since the last put of a build.
        logs_s: of log entries that are in snapshots: readers that were stopped for long may still need them.
    """

    things_s: float = DAY_S
    logs_s: float = 7 * DAY_S
    builds_s: float = 30 * DAY_S


@dataclass
class Garbage:
    """Removed keys by kind, or with a dry run those that would be removed."""

    keys: dict[str, list[str]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of the keys."""
        return sum(map(len, self.keys.values()))


def collect_garbage(
    catalog: Catalog, *, map_id: str | None = None, ages: Ages | None = None, dry_run: bool = False
) -> Garbage:
    """Remove the garbage of the whole store or of one map.

    Raises:
        InvalidOption: the map id is invalid.
        StoreError: the store failed. What was removed before stays removed.
    """
    ages = ages or Ages()
    now = catalog.store.now()
    cutoff = now - timedelta(seconds=ages.things_s)
    if map_id is not None:
        map_ids = [check_map_id(map_id)]
    else:
        map_ids = [name for name in catalog.store.folders("maps") if is_name(name)]
    found = Garbage()
    found.keys["versions"] = [
        key
        for name in map_ids
        for key in catalog.collect_garbage(name, older_than_s=ages.things_s, now=now, dry_run=dry_run)
    ]
    found.keys["logs"] = _logs(
        catalog, map_ids, min(cutoff, now - timedelta(seconds=ages.logs_s)), dry_run=dry_run
    )
    if map_id is None:
        found.keys["builds"] = _builds(catalog, now - timedelta(seconds=ages.builds_s))
        found.keys["uploads"] = _by_folder(catalog, "uploads", cutoff)
        found.keys[IDEMPOTENCY_FOLDER] = [item.key for item in _older(catalog, IDEMPOTENCY_FOLDER, cutoff)]
        found.keys[CALLERS_FOLDER] = _usage(catalog, now)
        found.keys["changes"] = change_garbage(catalog.store, cutoff)
        if not dry_run:
            for kind in ("builds", "uploads", IDEMPOTENCY_FOLDER, CALLERS_FOLDER, "changes"):
                _remove(catalog, found.keys[kind])
        announcements = [item.key for item in _older(catalog, PENDING_DELETIONS, cutoff)]
        if not dry_run:
            _remove(catalog, announcements)
        found.keys["leftovers"] = announcements + catalog.store.remove_leftovers(
            older_than_s=ages.things_s, dry_run=dry_run
        )
    old = [item for name in map_ids for item in _older(catalog, f"maps/{name}/sources", cutoff)]
    gone = {key.split("/")[1] for key in found.keys.get("builds", ())}
    found.keys["sources"] = _remove_unused_sources(catalog, old, gone, dry_run=dry_run)
    return found


def remove_abandoned(catalog: Catalog, *, older_than_s: float = DAY_S) -> Garbage:
    """Remove abandoned uploads and old idempotency keys and usage: the part that a service does by itself.

    Raises:
        StoreError: the store failed.
    """
    now = catalog.store.now()
    cutoff = now - timedelta(seconds=older_than_s)
    found = Garbage()
    found.keys["uploads"] = _by_folder(catalog, "uploads", cutoff)
    found.keys[IDEMPOTENCY_FOLDER] = [item.key for item in _older(catalog, IDEMPOTENCY_FOLDER, cutoff)]
    found.keys[CALLERS_FOLDER] = _usage(catalog, now)
    for keys in found.keys.values():
        _remove(catalog, keys)
    return found


def remove_sources_of(catalog: Catalog, build_id: str) -> None:
    """Remove the sources of a build that ended without a version, unless another build refers to them.

    Raises:
        StoreError: the store failed.
    """
    try:
        folder = f"maps/{check_map_id(catalog.builds.request(build_id)['map_id'])}/sources"
        keys = {key for key in _sources_of(catalog, build_id) if key.startswith(f"{folder}/")}
    except (UnreadableRecord, KeyError, InvalidOption):  # nobody can tell which
        return
    if keys:
        sources = [item for item in catalog.store.scan(folder) if item.key in keys]
        _remove_unused_sources(catalog, sources, set())


def _remove_unused_sources(
    catalog: Catalog, found: list[StoredObject], gone: set[str], *, dry_run: bool = False
) -> list[str]:
    """Remove those of the sources that no build needs. Returns their keys."""
    unused = _unused_sources(catalog, found, gone)
    if unused and not dry_run:
        # Announced, then checked again: if a build refers to one meanwhile, either we see its record, or it
        # sees the announcement.
        with announce_deletion(catalog.store, [item.key for item in unused]):
            unused = _unused_sources(catalog, unused, gone)
            _remove(catalog, [item.key for item in unused])
    return [item.key for item in unused]


def _logs(catalog: Catalog, map_ids: list[str], cutoff: datetime, *, dry_run: bool) -> list[str]:
    garbage = []
    for map_id in map_ids:
        folder = log_folder(map_id)
        if not dry_run:
            MapLog(catalog.store, folder).put_missing_snapshot()
        garbage += log_garbage(catalog.store, folder, cutoff)
    if not dry_run:
        _remove(catalog, garbage)
    return garbage


def _older(catalog: Catalog, folder: str, cutoff: datetime) -> list[StoredObject]:
    return [item for item in catalog.store.scan(folder) if item.last_modified < cutoff]


def _usage(catalog: Catalog, now: datetime) -> list[str]:
    return [item.key for item in _older(catalog, CALLERS_FOLDER, now - timedelta(days=USAGE_DAYS))]


def _by_folder(
    catalog: Catalog,
    folder: str,
    cutoff: datetime,
    is_garbage: Callable[[str], bool] = lambda name: True,
) -> list[str]:
    """Keys in those subfolders of a folder that have no newer object and are garbage."""
    items: dict[str, list[StoredObject]] = {}
    for item in catalog.store.scan(folder):
        items.setdefault(item.key.split("/")[1], []).append(item)
    return [
        item.key
        for name, inside in items.items()
        if max(item.last_modified for item in inside) < cutoff and is_garbage(name)
        # the object that makes the thing exist goes first: a kill half-way leaves nothing that seems whole
        for item in sorted(inside, key=lambda item: not item.key.endswith(("/upload.json", "/request.json")))
    ]


def _builds(catalog: Catalog, cutoff: datetime) -> list[str]:
    published: dict[str, tuple[str, ...]] = {}

    def is_garbage(build_id: str) -> bool:
        if not is_name(build_id):
            return False
        try:
            status = catalog.builds.status(build_id)
        except NotFound:  # left by a removal that was killed
            return True
        except UnreadableRecord:  # nobody can tell whether it has ended
            return False
        if status["state"] not in FINAL_STATES:
            return False
        map_id = str(status.get("map_id", ""))
        if status.get("version") is None or not is_name(map_id):
            return True
        if map_id not in published:
            published[map_id] = catalog.state(map_id).published
        return status["version"] not in published[map_id]

    return _by_folder(catalog, "builds", cutoff, is_garbage)


def _unused_sources(catalog: Catalog, found: list[StoredObject], gone: set[str]) -> list[StoredObject]:
    """Sources that no build needs, apart from builds that are gone."""
    if not found:
        return []
    keys = {item.key for item in found}

    def needed(build_id: str) -> set[str] | None:
        """Sources that a build needs; None if its record is damaged."""
        try:
            named = keys.intersection(_sources_of(catalog, build_id))
            return set() if named and _ended_without_version(catalog, build_id) else named
        except UnreadableRecord:
            return None

    needs = read_each([build_id for build_id in catalog.builds.ids() if build_id not in gone], needed)
    used = set().union(*(named for named in needs.values() if named is not None))
    unread: list[StoredObject] = []
    for build_id, named in needs.items():
        if named is None:
            unread += catalog.store.scan(f"builds/{build_id}")
    return [item for item in found if item.key not in used and not _may_be_used(item, unread)]


def _ended_without_version(catalog: Catalog, build_id: str) -> bool:
    """Whether a build failed or was cancelled, and no version in service is its own."""
    status = catalog.builds.status(build_id)
    if status["state"] not in FINAL_STATES - {"succeeded"}:
        return False
    map_id = str(status["map_id"])
    return not is_name(map_id) or not catalog.state(map_id).published_by(build_id)


def _sources_of(catalog: Catalog, build_id: str) -> list[str]:
    try:
        request = catalog.builds.request(build_id)
    except NotFound:
        return []
    named = (request.get(role) for role in ("source", "trajectory"))
    keys = [str(one["key"]) for one in named if isinstance(one, dict) and "key" in one]
    return [*keys, *(f"{key}.{build_id}" for key in keys)]


def _may_be_used(source: StoredObject, unread: list[StoredObject]) -> bool:
    """Whether a damaged request may refer to the source: a source is put before the request."""
    requests = (item for item in unread if item.key.endswith("/request.json"))
    return any(source.last_modified <= request.last_modified for request in requests)


def _remove(catalog: Catalog, keys: Iterable[str]) -> None:
    for key in keys:
        catalog.store.delete(key)
