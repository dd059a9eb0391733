"""Keys that garbage collections are about to remove, announced to those who may still want them.

    doomed/<random id>    keys, one a line: put before a collection looks whether anybody names them, deleted
                          after it has removed them

Whoever names an object that was there already, and then finds no collection that dooms it, is seen by every
collection that comes to doom it later. Otherwise the object may go at any moment, or has gone: then a copy
under a key that no collection knows is safe.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ..errors import NotFound
from ..store.store import Store

FOLDER = "doomed"


@contextmanager
def announced(store: Store, keys: Sequence[str]) -> Iterator[None]:
    """Dooms the keys as long as the context lasts: nothing may be removed after it.

    A collection that is killed leaves its list, which costs others a copy until it is removed with age.
    """
    key = f"{FOLDER}/{uuid.uuid4().hex}"
    store.put_new(key, "\n".join(keys).encode("ascii"))
    try:
        yield
    finally:
        store.delete(key)


def is_doomed(store: Store, key: str) -> bool:
    """Whether some collection may remove it."""
    for listed in store.list(FOLDER):
        try:
            if key in store.get(listed).decode("ascii", "replace").split("\n"):
                return True
        except NotFound:  # that one has ended
            continue
    return False
