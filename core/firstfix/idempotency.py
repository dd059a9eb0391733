"""Requests that are safe to repeat: a caller's key stands for one build, on whichever replica it arrives.

idempotency/<sha256 of the key>    create-only: which request it was first used for, and its build
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from .errors import IdempotencyConflict, NotFound
from .ids import check_build_id
from .json_record import RecordKind, read_record, text_of
from .store import Store

FOLDER = "idempotency"


def claim_build(store: Store, key: str, fingerprint: str, build_id: str) -> str:
    """The build that the key stands for: this one, or the one of the first request with the key.

    The claim comes before the build is recorded, so after a kill between the two the repeated request
    is given the id under which to record it.

    Args:
        fingerprint: equal for equal requests.

    Raises:
        IdempotencyConflict: the key was used for another request.
        UnreadableRecord: which request it was used for is damaged: the caller needs another key.
    """
    name = f"{FOLDER}/{hashlib.sha256(key.encode()).hexdigest()}"
    record = json.dumps({"fingerprint": fingerprint, "build_id": build_id}).encode()
    if store.put_new(name, record):
        return build_id
    try:
        claimed, theirs = read_record(store, name, RecordKind.IDEMPOTENCY_KEY, parse_claim)
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
