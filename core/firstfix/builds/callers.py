"""Records of callers: their builds and build minutes, and the idempotency keys of their requests.

    callers/<sha256 of the caller>/builds/<build_id>                            put before the build's record
    callers/<sha256 of the caller>/minutes/<day>/<build_id>.<attempt>.<seconds> put when an attempt has ended
    idempotency/<sha256 of caller and key>    create-only: the request that first used the key, and its build

Builds and minutes are counted so that no caller takes them all. One listing finds either, however many builds
other callers have. The entry of a build is removed once the build has ended. The names alone tell the seconds
of a day (UTC).

A caller's idempotency key stands for one build, on any replica, so requests are safe to repeat. The same key
of two callers is two keys.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from ..errors import IdempotencyConflict, NotFound, UnreadableRecord
from ..ids import check_build_id, is_name
from ..store.json_record import RecordKind, read_record, record_json, text_of
from ..store.store import Store
from .records import FINAL_STATES, BuildRecords

CALLERS_FOLDER = "callers"
IDEMPOTENCY_FOLDER = "idempotency"
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
                state = self._records.status(build_id)["state"]
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
    return f"{CALLERS_FOLDER}/{hashlib.sha256(owner.encode()).hexdigest()}"


def _today() -> str:
    return f"{datetime.now(timezone.utc):%Y%m%d}"


@dataclass(frozen=True)
class CallersKey:
    """``Idempotency-Key`` of a request, with the name of the caller who sent it."""

    caller: str
    key: str

    @property
    def name(self) -> str:
        """Key of its object in the store; different for different callers or keys."""
        text = json.dumps([self.caller, self.key])
        return f"{IDEMPOTENCY_FOLDER}/{hashlib.sha256(text.encode()).hexdigest()}"


def claimed_build(store: Store, key: CallersKey) -> str | None:
    """Id of the key's build, which may not be recorded yet; None if the key is new."""
    try:
        return _read(store, key)[0]
    except NotFound:
        return None


def claim_build(store: Store, key: CallersKey, fingerprint: str, build_id: str) -> str:
    """Claim the key for a build. Returns this build's id, or that of the first request with the key.

    The claim is put before the build is recorded. After a kill between the two, the repeated request gets the
    id under which to record the build.

    Args:
        fingerprint: equal for equal requests.

    Raises:
        IdempotencyConflict: the key was used for another request.
        UnreadableRecord: the claim is damaged: the caller needs another key.
    """
    record = record_json({"fingerprint": fingerprint, "build_id": build_id})
    if store.put_new(key.name, record):
        return build_id
    try:
        claimed, theirs = _read(store, key)
    except NotFound:  # it has just expired
        return claim_build(store, key, fingerprint, build_id)
    if theirs != fingerprint:
        raise IdempotencyConflict("this Idempotency-Key was used for another request")
    return claimed


def parse_claim(record: dict[str, Any]) -> tuple[str, str]:
    """Build id and fingerprint of a claim's record.

    Raises:
        KeyError, TypeError, InvalidOption: it is not a claim.
    """
    return check_build_id(text_of(record, "build_id")), text_of(record, "fingerprint")


def _read(store: Store, key: CallersKey) -> tuple[str, str]:
    """Build id and fingerprint of the first request with the key."""
    return read_record(store, key.name, RecordKind.IDEMPOTENCY_KEY, parse_claim)
