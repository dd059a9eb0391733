"""Builds and build minutes of each caller, counted in the store, so that one cannot have them all.

    callers/<sha256 of the caller>/builds/<build_id>                            before the build is on record
    callers/<sha256 of the caller>/minutes/<day>/<build_id>.<attempt>.<seconds> once an attempt has ended

Both are found with one listing, however many builds others have. An entry of a build goes when the build is
seen to have ended; the seconds of a day (UTC) are told by the names alone.
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
    """Builds by the caller who handed them in. Thread-safe.

    Every method raises StoreUnavailable or StoreError as the store does.
    """

    def __init__(self, records: BuildRecords) -> None:
        self._records = records
        self._store = records.store

    def begin(self, owner: str, build_id: str) -> None:
        """Enters a build that is about to be put on record. Again does no harm."""
        self._store.put_new(f"{_folder(owner)}/builds/{check_build_id(build_id)}", b"")

    def unfinished(self, owner: str) -> set[str]:
        """The caller's builds on record that have not ended; entries of others are removed."""
        prefix = f"{_folder(owner)}/builds"
        found = set()
        for key in self._store.list(prefix):
            build_id = key.rsplit("/", 1)[-1]
            if not is_name(build_id):
                continue
            try:
                state = self._records.build_status(build_id)["state"]
            except UnreadableRecord:  # it is not run
                continue
            except NotFound:  # about to be put on record, or nobody lived to do so: that one expires
                continue
            if state in FINAL_STATES:
                self._store.delete(key)
            else:
                found.add(build_id)
        return found

    def charge(self, owner: str, build_id: str, attempt: int, ran_s: float) -> None:
        """Counts an attempt that has ended to the caller's day."""
        name = f"{check_build_id(build_id)}.{attempt}.{max(round(ran_s), 0)}"
        self._store.put_new(f"{_folder(owner)}/minutes/{_today()}/{name}", b"")

    def minutes_today(self, owner: str) -> float:
        """Of the attempts that ended since midnight, UTC."""
        names = (key.rsplit("/", 1)[-1] for key in self._store.list(f"{_folder(owner)}/minutes/{_today()}"))
        return sum(int(run[1]) for name in names if (run := _RUN.fullmatch(name))) / 60


def _folder(owner: str) -> str:
    return f"{FOLDER}/{hashlib.sha256(owner.encode()).hexdigest()}"


def _today() -> str:
    return f"{datetime.now(timezone.utc):%Y%m%d}"
