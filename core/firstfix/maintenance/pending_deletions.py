"""Announcements of objects that a garbage collection is about to delete.

    pending_deletions/<random id>    keys, one a line: put before the collection checks whether anything
    refers to
                                     them, deleted after it has deleted them

A process that refers to an existing object, and then finds no pending deletion of it, is seen by every later
collection. Otherwise the object may be deleted at any moment: then a copy under another key is safe, because
no collection knows that key.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ..errors import NotFound
from ..store.store import Store

FOLDER = "pending_deletions"


@contextmanager
def announce_deletion(store: Store, keys: Sequence[str]) -> Iterator[None]:
    """Announce that keys may be deleted while the context lasts. None may be deleted after it.

    A collection that is killed leaves its announcement. This makes others copy objects without need, until
    the announcement is old enough to be removed.
    """
    key = f"{FOLDER}/{uuid.uuid4().hex}"
    store.put_new(key, "\n".join(keys).encode("ascii"))
    try:
        yield
    finally:
        store.delete(key)


def is_deletion_pending(store: Store, key: str) -> bool:
    """Whether a collection may delete the object."""
    for announcement in store.list(FOLDER):
        try:
            if key in store.get(announcement).decode("ascii", "replace").split("\n"):
                return True
        except NotFound:  # that collection has ended
            continue
    return False
