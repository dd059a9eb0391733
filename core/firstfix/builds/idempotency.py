"""Requests that are safe to repeat: a caller's key stands for one build, on whichever replica it arrives.

idempotency/<sha256 of caller and key>    create-only: which request it was first used for, and its build

Keys of one caller mean nothing to another. Names that an earlier release made, of the key alone, are not
looked at: a request that is repeated after the upgrade makes a second build. They expire like all others.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from ..errors import IdempotencyConflict, NotFound
from ..ids import check_build_id
from ..store.json_record import RecordKind, read_record, text_of
from ..store.store import Store

FOLDER = "idempotency"


@dataclass(frozen=True)
class CallersKey:
    """An ``Idempotency-Key`` and the name of the caller who sent it."""

    caller: str
    key: str

    @property
    def name(self) -> str:
        """Of its object in the store; never the same for two callers or two keys."""
        text = json.dumps([self.caller, self.key])
        return f"{FOLDER}/{hashlib.sha256(text.encode()).hexdigest()}"


def claimed_build(store: Store, key: CallersKey) -> str | None:
    """The build that the key stands for, which may not be on record yet; None: it stands for none."""
    try:
        return _read(store, key)[0]
    except NotFound:
        return None


def claim_build(store: Store, key: CallersKey, fingerprint: str, build_id: str) -> str:
    """The build that the key stands for: this one, or the one of the first request with the key.

    The claim comes before the build is recorded, so after a kill between the two the repeated request
    is given the id under which to record it.

    Args:
        fingerprint: equal for equal requests.

    Raises:
        IdempotencyConflict: the key was used for another request.
        UnreadableRecord: which request it was used for is damaged: the caller needs another key.
    """
    record = json.dumps({"fingerprint": fingerprint, "build_id": build_id}).encode()
    if store.put_new(key.name, record):
        return build_id
    try:
        claimed, theirs = _read(store, key)
    except NotFound:  # forgotten just now
        return claim_build(store, key, fingerprint, build_id)
    if theirs != fingerprint:
        raise IdempotencyConflict("this Idempotency-Key was used for another request")
    return claimed


def parse_claim(record: dict[str, Any]) -> tuple[str, str]:
    """The build and the fingerprint of a claim.

    Raises:
        KeyError, TypeError, InvalidOption: not a claim.
    """
    return check_build_id(text_of(record, "build_id")), text_of(record, "fingerprint")


def _read(store: Store, key: CallersKey) -> tuple[str, str]:
    """Build and fingerprint that the key was first used with."""
    return read_record(store, key.name, RecordKind.IDEMPOTENCY_KEY, parse_claim)
