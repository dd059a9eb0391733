"""Record of the version of a map that a robot answered with last: it starts with that one without a network.

The record is the version's manifest, so it says which files in the cache are the right ones.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from pathlib import Path

from ...errors import VersionError
from ...ids import check_map_id
from ..manifest import MAX_BYTES, Manifest


class LastServed:
    """Record of one map of one store.

    Args:
        directory: folder of the records; made if missing.
        store_url: two stores may have maps of the same id. It may hold secrets: only its hash is written.

    Raises:
        InvalidOption: not a valid map id.
    """

    def __init__(self, directory: Path, store_url: str, map_id: str) -> None:
        of_store = hashlib.sha256(store_url.encode()).hexdigest()[:16]
        self._path = directory / of_store / f"{check_map_id(map_id)}.json"

    def read(self) -> Manifest | None:
        """The manifest of the last version. None without one that can be read."""
        try:
            if self._path.stat().st_size > MAX_BYTES:
                return None
            return Manifest.from_json(self._path.read_bytes())
        except (OSError, VersionError):
            return None

    def write(self, manifest: Manifest) -> None:
        """Replace the record. A power cut leaves the old one or the new one.

        Raises:
            OSError: it cannot be written.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        part = self._path.with_name(f"{self._path.name}.{uuid.uuid4().hex}.part")
        try:
            with part.open("wb") as file:
                file.write(manifest.to_json())
                file.flush()
                os.fsync(file.fileno())
            part.replace(self._path)
        finally:
            part.unlink(missing_ok=True)

    def forget(self) -> None:
        """Remove the record."""
        self._path.unlink(missing_ok=True)
