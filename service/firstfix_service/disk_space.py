"""Room for what arrives: asked for before it is taken."""

from __future__ import annotations

import shutil
from pathlib import Path

from firstfix.errors import OutOfSpace
from firstfix.store import Store


def check_free_disk(directory: Path, wanted_bytes: int, reserve_bytes: int) -> None:
    """
    Raises:
        OutOfSpace: less than the reserve would be left on the directory's disk.
    """
    _check("this service's disk", shutil.disk_usage(directory).free, wanted_bytes, reserve_bytes)


def check_free_store(store: Store, wanted_bytes: int, reserve_bytes: int) -> None:
    """As ``check_free_disk``, of a store that is a directory. Others do not tell."""
    free = store.free_bytes()
    if free is not None:
        _check("the store's disk", free, wanted_bytes, reserve_bytes)


def _check(where: str, free_bytes: int, wanted_bytes: int, reserve_bytes: int) -> None:
    if free_bytes - wanted_bytes < reserve_bytes:
        raise OutOfSpace(f"{where} has no room for {wanted_bytes} bytes")
