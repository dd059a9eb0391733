"""Stores that commands read: they must be there."""

from __future__ import annotations

from pathlib import Path

from firstfix.errors import NotFound
from firstfix.store.store import Store
from firstfix.store.url import StoreUrl


def existing_store(url: str, *, read_only: bool = False) -> Store:
    """Open a store that holds something already.

    Raises:
        NotFound: the folder is not there. A bucket is asked with the first request.
        InvalidOption: as ``Store.open``.
    """
    where = StoreUrl.parse(url)
    if where.scheme == "file" and not Path(where.prefix).is_dir():
        raise NotFound(f"no store at {url}: there is no such folder")
    return Store.open_at(where, read_only=read_only)
