"""The files of a version on this machine, before it is loaded."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.catalog.versions.folder_lock import FolderLock

from ..query_workers.query import ServedVersion

Key = tuple[str, str]  # map id, version


@dataclass(frozen=True)
class VersionFiles:
    """The files of a version on this machine.

    Attributes:
        folder_lock: keeps a fetched folder on the disk; None for a version in a file store.
    """

    served: ServedVersion
    file_bytes: int
    folder_lock: FolderLock | None

    @property
    def key(self) -> Key:
        """Map id and version."""
        return self.served.map_id, self.served.version
