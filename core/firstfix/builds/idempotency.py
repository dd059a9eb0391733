"""Idempotency keys: a caller's key stands for one build, on any replica, so requests are safe to repeat.

idempotency/<sha256 of caller and key>    create-only: the request that first used the key, and its build

The same key of two callers is two keys.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from ..errors import IdempotencyConflict, NotFound
from ..ids import check_build_id
from ..store.json_record import RecordKind, read_record, record_json, text_of
from ..store.store import Store

FOLDER = "idempotency"


@dataclass(frozen=True)
class CallersKey:
    """``Idempotency-Key`` of a request, with the name of the caller who sent it."""

    caller: str
    key: str

    @property
    def name(self) -> str:
        """Key of its object in the store; different for different callers or keys."""
        text = json.dumps([self.caller, self.key])
        return f"{FOLDER}/{hashlib.sha256(text.encode()).hexdigest()}"


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
