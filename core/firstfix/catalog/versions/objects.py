"""Files of versions in an object store. The manifest is written last and read first.

maps/<map_id>/versions/<digest>/...           first generation of a version's files
maps/<map_id>/versions/<digest>.<seq>/...     generation that began after entry <seq> of the map's log ended
the
                                              one before (``firstfix.catalog.log.map_log``)
"""

from __future__ import annotations

import hashlib
import logging
import re
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ...errors import CorruptVersion, NotFound, StoreUnavailable, TooLarge
from ...ids import check_map_id, check_version
from ...store.store import Store, StoredObject
from ..manifest import FILE_NAME, MAX_BYTES, Manifest
from .cache import fetch_version_files

_log = logging.getLogger(__name__)
_MANIFESTS_KEPT = 256  # each may be some 100 kB
_MAX_ROUNDS = 5  # of putting missing files
_FOLDER_NAME = re.compile(r"([0-9a-f]{64})(?:\.(\d{6,}))?")


@dataclass(frozen=True)
class VersionFolder:
    """Folder with the files of a version.

    Attributes:
        generation: see ``firstfix.catalog.log.map_log``.
    """

    map_id: str
    version: str
    generation: int

    @property
    def key(self) -> str:
        """Key of the folder.

        Raises:
            InvalidOption: the map id or the version is invalid.
        """
        generation = f".{self.generation:06d}" if self.generation else ""
        return f"maps/{check_map_id(self.map_id)}/versions/{check_version(self.version)}{generation}"

    @property
    def manifest_key(self) -> str:
        """Key of the manifest."""
        return f"{self.key}/{FILE_NAME}"


class VersionObjects:
    """Files of versions, whether or not they are published in a map's log. Thread-safe."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._manifests: OrderedDict[tuple[str, str], Manifest] = OrderedDict()
        self._lock = threading.Lock()

    def exists(self, folder: VersionFolder) -> bool:
        """Whether the version has a manifest."""
        return self._store.exists(folder.manifest_key)

    def manifest(self, folder: VersionFolder) -> Manifest:
        """Read the manifest of a version.

        Raises:
            CorruptVersion: the manifest is missing, or its digest is not the version.
            IncompatibleVersion: this release does not read its format.
        """
        map_id, version = folder.map_id, folder.version
        with self._lock:
            known = self._manifests.get((map_id, version))
            if known is not None:
                self._manifests.move_to_end((map_id, version))
                return known
        key = folder.manifest_key
        try:
            size = self._store.size(key)
            if size > MAX_BYTES:
                raise CorruptVersion(f"a manifest of {size} bytes")
            manifest = Manifest.from_json(self._store.get(key))
        except NotFound:
            raise CorruptVersion(f"version {version} of map {map_id} has lost its manifest") from None
        if manifest.digest != version:
            raise CorruptVersion(f"the manifest of version {version} of map {map_id} was altered")
        with self._lock:
            self._manifests[(map_id, version)] = manifest
            while len(self._manifests) > _MANIFESTS_KEPT:
                self._manifests.popitem(last=False)
        return manifest

    def fetch(self, folder: VersionFolder, directory: Path) -> Path:
        """Fetch the version's files to a local folder; see ``fetch_version_files``."""
        manifest = self.manifest(folder)
        return fetch_version_files(self._store, folder.key, folder.version, manifest, directory)

    def read_file(self, folder: VersionFolder, name: str, *, max_bytes: int) -> bytes:
        """Read one file and verify its sha256.

        Raises:
            NotFound: the version has no such file.
            TooLarge: the file has more than ``max_bytes``.
            CorruptVersion: see ``manifest``; or the file is missing or differs.
        """
        map_id, version = folder.map_id, folder.version
        entry = self.manifest(folder).files.get(name)
        if entry is None:
            raise NotFound(f"version {version} of map {map_id} has no {name}")
        if entry.bytes > max_bytes:
            raise TooLarge(f"{name} has {entry.bytes} bytes, the limit is {max_bytes}")
        try:
            data = self._store.get(f"{folder.key}/{name}")
        except NotFound:
            raise CorruptVersion(f"version {version} of map {map_id} has lost {name}") from None
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            raise CorruptVersion(f"{name} of version {version} of map {map_id} was altered")
        return data

    def put(
        self,
        folder: VersionFolder,
        directory: Path,
        manifest: Manifest,
        on_progress: Callable[[float], None] = lambda done: None,
    ) -> None:
        """Put every file, then the manifest, and check that all of them are there.

        Repeating it after a kill at any point completes it. It also repairs damaged objects, because the
        manifest tells their right content.

        Args:
            on_progress: called after each file with the share of the bytes that are put, 0..1.

        Raises:
            CorruptVersion: a file in the directory differs from the manifest.
            OutOfSpace: the store has no room for the files that are not there yet. Nothing was put.
            StoreUnavailable: another process removes the files again and again.
        """
        manifest.verify_directory(directory)
        there = {item.key: item.size_bytes for item in self._store.scan(folder.key)}
        missing_bytes = sum(
            entry.bytes
            for name, entry in manifest.files.items()
            if there.get(f"{folder.key}/{name}") != entry.bytes
        )
        if missing_bytes:
            self._store.check_room(missing_bytes, f"version {folder.version} of map {folder.map_id}")
        all_bytes = sum(entry.bytes for entry in manifest.files.values())
        for _ in range(_MAX_ROUNDS):
            put_bytes = 0
            for name in manifest.files:
                self._store.put_file(f"{folder.key}/{name}", directory / name)
                put_bytes += manifest.files[name].bytes
                on_progress(put_bytes / all_bytes if all_bytes else 1.0)
            content, key = manifest.to_json(), folder.manifest_key
            with suppress(NotFound):  # another process has just removed it: try again
                if not self._store.put_new(key, content) and self._store.get(key) != content:
                    _log.warning("%s is damaged and is written again", key)
                    self._store.put(key, content)
                if self._is_whole(folder, manifest):
                    return
        raise StoreUnavailable(f"{folder.key}: another process removes the files that are put")

    def _is_whole(self, folder: VersionFolder, manifest: Manifest) -> bool:
        """Whether every file is there with its size. One listing."""
        sizes = {item.key: item.size_bytes for item in self._store.scan(folder.key)}
        files = {f"{folder.key}/{name}": entry.bytes for name, entry in manifest.files.items()}
        return folder.manifest_key in sizes and files.items() <= sizes.items()

    def scan(self, map_id: str) -> dict[VersionFolder, list[StoredObject]]:
        """All objects of all versions of a map, by folder."""
        found: dict[VersionFolder, list[StoredObject]] = {}
        for item in self._store.scan(f"maps/{check_map_id(map_id)}/versions"):
            if match := _FOLDER_NAME.fullmatch(item.key.split("/")[3]):
                folder = VersionFolder(map_id, match[1], int(match[2] or 0))
                found.setdefault(folder, []).append(item)
        return found

    def remove(self, folder: VersionFolder, keys: list[str]) -> None:
        """Remove objects, the manifest first: without it the version does not exist."""
        for key in manifest_first(keys):
            self._store.delete(key)
        with self._lock:
            self._manifests.pop((folder.map_id, folder.version), None)


def manifest_first(keys: list[str]) -> list[str]:
    """Sort keys so that the manifest is the first."""
    return sorted(keys, key=lambda key: not key.endswith(f"/{FILE_NAME}"))
