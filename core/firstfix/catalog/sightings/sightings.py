"""Sightings of map versions in a store, merged from all replicas.

    <folder of the version>/sightings/<time>-<random>.json     a part: what one replica counted in a while
    <folder of the version>/sightings/merged/000001.json ...   sums of parts; the last one is valid

Every object is put once and never changed. A merged object names its parts, and readers skip these, so a
part counts once, whether or not it is removed already. Of several replicas that merge at the same time, the
first one wins: the number is taken. As the objects lie in the version's folder, they are removed with it.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from typing import TypeVar

from ...engine.changes.tally import Tally
from ...errors import NotFound, StoreUnavailable, UnreadableRecord
from ...store.json_record import RecordKind, read_each, read_record
from ...store.numbered import scan_after
from ...store.store import Store
from ..versions.objects import VersionFolder
from .record import EMPTY, SightingsRecord

MERGE_FROM = 24  # parts: a reader reads few objects
KEPT_DAYS = 30
_MAX_LOOKS = 5
_TIME_FORM = "%Y%m%dt%H%M%S%f"
T = TypeVar("T")


class Sightings:
    """Sightings in a store. Thread-safe.

    Every method raises StoreUnavailable or StoreError if the store fails.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def put(self, folder: VersionFolder, tally: Tally, now: datetime) -> None:
        """Store counts as a part.

        Args:
            now: by the store's clock.
        """
        name = f"{now.astimezone(timezone.utc).strftime(_TIME_FORM)}-{secrets.token_hex(4)}.json"
        self._store.put_new(f"{_folder(folder)}/{name}", SightingsRecord.of(tally, now).to_json())

    def read(self, folder: VersionFolder) -> SightingsRecord:
        """All sightings of a version. Damaged objects are skipped; ``Store.unreadable`` reports them."""
        return self._look(folder, lambda merged, parts: merged[1].plus(self._read_parts(folder, parts)))

    def state(self, folder: VersionFolder) -> tuple[int, tuple[str, ...]]:
        """State of what is stored: number of the merged record, and names of all parts.

        Objects never change, so while this stays the same, so does what they tell.
        """
        return self._last_merged(folder), tuple(self._names(folder))

    def merge(self, folder: VersionFolder, today: datetime) -> bool:
        """Sum up the parts of a version, if there are many. Returns whether this was done.

        Args:
            today: by the store's clock. Sightings of more than KEPT_DAYS before are dropped.
        """

        def merge(merged: tuple[int, SightingsRecord], parts: list[str]) -> bool:
            number, before = merged
            if len(parts) < MERGE_FROM:
                return False
            found = self._read_parts(folder, parts)
            oldest = (today - timedelta(days=KEPT_DAYS)).date().isoformat()
            # of the parts merged before, only those that are still there must be skipped on
            there = set(self._names(folder))
            still = tuple(name for name in before.parts if name in there)
            total = SightingsRecord(before.days, still).plus(found).since(oldest)
            key = f"{_folder(folder)}/merged/{number + 1:06d}.json"
            if not self._store.put_new(key, total.to_json()):
                return False
            for name in total.parts:
                self._store.delete(f"{_folder(folder)}/{name}")
            for old in scan_after(self._store, f"{_folder(folder)}/merged", 0):
                if old <= number:
                    self._store.delete(f"{_folder(folder)}/merged/{old:06d}.json")
            return True

        return self._look(folder, merge)

    def _look(self, folder: VersionFolder, use: Callable[[tuple[int, SightingsRecord], list[str]], T]) -> T:
        """Call ``use`` with the last merged record and its number, and the names of the parts not in it."""
        for _ in range(_MAX_LOOKS):
            number = self._last_merged(folder)
            names = self._names(folder)
            try:
                merged = self._read_one(folder, f"merged/{number:06d}.json") if number else EMPTY
                return use((number, merged), [name for name in names if name not in set(merged.parts)])
            except UnreadableRecord:
                return use((number, EMPTY), names)
            except NotFound:  # merged and removed meanwhile
                continue
        raise StoreUnavailable(f"{_folder(folder)}: its parts were merged while they were read")

    def _last_merged(self, folder: VersionFolder) -> int:
        """Number of the valid merged record; 0: there is none."""
        return max(scan_after(self._store, f"{_folder(folder)}/merged", 0), default=0)

    def _names(self, folder: VersionFolder) -> list[str]:
        own = _folder(folder)
        names = (key[len(own) + 1 :] for key in self._store.list(own))
        return [name for name in names if "/" not in name and name.endswith(".json")]

    def _read_parts(self, folder: VersionFolder, names: list[str]) -> list[tuple[str, SightingsRecord]]:
        def read(name: str) -> SightingsRecord | None:
            try:
                return self._read_one(folder, name)
            except UnreadableRecord:
                return None

        return [(name, part) for name, part in read_each(names, read).items() if part is not None]

    def _read_one(self, folder: VersionFolder, name: str) -> SightingsRecord:
        key = f"{_folder(folder)}/{name}"
        return read_record(self._store, key, RecordKind.SIGHTINGS, SightingsRecord.parse)


def _folder(folder: VersionFolder) -> str:
    return f"{folder.key}/sightings"
