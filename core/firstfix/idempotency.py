"""Requests that are safe to repeat: a caller's key stands for one build, on whichever replica it arrives.

idempotency/<sha256 of the key>    create-only: which request it was first used for, and its build
"""

from __future__ import annotations

import hashlib
import json

from .errors import IdempotencyConflict, NotFound, StoreError
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
    """
    name = f"{FOLDER}/{hashlib.sha256(key.encode()).hexdigest()}"
    record = json.dumps({"fingerprint": fingerprint, "build_id": build_id}).encode()
    if store.put_new(name, record):
        return build_id
    try:
        first = json.loads(store.get(name))
        claimed, theirs = str(first["build_id"]), str(first["fingerprint"])
    except NotFound:  # forgotten just now
        return claim_build(store, key, fingerprint, build_id)
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{name} is no record of a key: {error!r}") from None
    if theirs != fingerprint:
        raise IdempotencyConflict("this Idempotency-Key was used for another request")
    return claimed
