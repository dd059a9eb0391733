"""Builds and build minutes of each caller, counted in the store, so that no caller takes them all.

    callers/<sha256 of the caller>/builds/<build_id>                            put before the build's record
    callers/<sha256 of the caller>/minutes/<day>/<build_id>.<attempt>.<seconds> put when an attempt has ended

One listing finds either, however many builds other callers have. The entry of a build is removed once the
build has ended. The names alone tell the seconds of a day (UTC).
"""

from __future__ import annotations

import hashlib
import re
from datetime import datetime, timezone

from ..errors import NotFound, UnreadableRecord
from ..ids import check_build_id, is_name
from .records import FINAL_STATES, BuildRecords

FOLDER = "callers"
_RUN = re.compile(r"[a-z0-9_-]{1,63}\.\d{1,9}\.(\d{1,9})")


class CallerUsage:
    """Builds by the caller who submitted them. Thread-safe.

    Every method raises StoreUnavailable or StoreError if the store fails.
    """

    def __init__(self, records: BuildRecords) -> None:
        self._records = records
        self._store = records.store

    def begin(self, owner: str, build_id: str) -> None:
        """Enter a build that is about to be recorded. Safe to repeat."""
        self._store.put_new(f"{_folder(owner)}/builds/{check_build_id(build_id)}", b"")

    def unfinished(self, owner: str) -> set[str]:
        """Ids of the caller's recorded builds that have not ended. Removes the entries of ended ones."""
        prefix = f"{_folder(owner)}/builds"
        found = set()
        for key in self._store.list(prefix):
            build_id = key.rsplit("/", 1)[-1]
            if not is_name(build_id):
                continue
            try:
                state = self._records.build_status(build_id)["state"]
            except UnreadableRecord:  # such a build is not run
                continue
            except NotFound:  # about to be recorded; or its process was killed, and the entry expires
                continue
            if state in FINAL_STATES:
                self._store.delete(key)
            else:
                found.add(build_id)
        return found

    def charge(self, owner: str, build_id: str, attempt: int, ran_s: float) -> None:
        """Add an ended attempt to the caller's minutes of today."""
        name = f"{check_build_id(build_id)}.{attempt}.{max(round(ran_s), 0)}"
        self._store.put_new(f"{_folder(owner)}/minutes/{_today()}/{name}", b"")

    def minutes_today(self, owner: str) -> float:
        """Minutes of the attempts that ended since midnight, UTC."""
        names = (key.rsplit("/", 1)[-1] for key in self._store.list(f"{_folder(owner)}/minutes/{_today()}"))
        return sum(int(run[1]) for name in names if (run := _RUN.fullmatch(name))) / 60


def _folder(owner: str) -> str:
    return f"{FOLDER}/{hashlib.sha256(owner.encode()).hexdigest()}"


def _today() -> str:
    return f"{datetime.now(timezone.utc):%Y%m%d}"
