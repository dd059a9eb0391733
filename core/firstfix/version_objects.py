"""Files of versions in an object store, below their manifest, which is written last and read first."""

from __future__ import annotations

import hashlib
import logging
import threading
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path

from .errors import CorruptVersion, NotFound, TooLarge
from .ids import check_map_id, check_version
from .manifest import FILE_NAME, MAX_BYTES, Manifest
from .store import Store, StoredObject
from .version_cache import fetch_version_files

_log = logging.getLogger(__name__)
_MANIFESTS_KEPT = 256  # each may be some 100 kB


class VersionObjects:
    """What a version consists of, whether or not a map's log speaks of it. Thread-safe."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._manifests: OrderedDict[tuple[str, str], Manifest] = OrderedDict()
        self._lock = threading.Lock()

    def exists(self, map_id: str, version: str) -> bool:
        return self._store.exists(_manifest_key(map_id, version))

    def manifest(self, map_id: str, version: str) -> Manifest:
        """
        Raises:
            CorruptVersion: the manifest is missing or is not the one that the version is named by.
            IncompatibleVersion: its format is not this reader's.
        """
        with self._lock:
            known = self._manifests.get((map_id, version))
            if known is not None:
                self._manifests.move_to_end((map_id, version))
                return known
        key = _manifest_key(map_id, version)
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

    def fetch(self, map_id: str, version: str, directory: Path) -> Path:
        """The local folder with the version's files; see ``fetch_version_files``."""
        manifest = self.manifest(map_id, version)
        return fetch_version_files(self._store, _folder(map_id, version), version, manifest, directory)

    def read_file(self, map_id: str, version: str, name: str, *, max_bytes: int) -> bytes:
        """One file, checked by its sha256.

        Raises:
            NotFound: the version has no such file.
            TooLarge: it is over the limit.
            CorruptVersion: as ``manifest``, or the file is missing or differs.
        """
        entry = self.manifest(map_id, version).files.get(name)
        if entry is None:
            raise NotFound(f"version {version} of map {map_id} has no {name}")
        if entry.bytes > max_bytes:
            raise TooLarge(f"{name} has {entry.bytes} bytes, the limit is {max_bytes}")
        try:
            data = self._store.get(f"{_folder(map_id, version)}/{name}")
        except NotFound:
            raise CorruptVersion(f"version {version} of map {map_id} has lost {name}") from None
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            raise CorruptVersion(f"{name} of version {version} of map {map_id} was altered")
        return data

    def put(self, map_id: str, directory: Path, manifest: Manifest) -> None:
        """Every file, then the manifest. Repeating it after a kill at any point completes it, and mends what
        a fault altered since: the version is named by what it has to be.

        Raises:
            CorruptVersion: a file in the directory is not what the manifest says.
        """
        version = manifest.digest
        manifest.verify_directory(directory)
        for name in manifest.files:
            self._store.upload(f"{_folder(map_id, version)}/{name}", directory / name)
        content, key = manifest.to_json(), _manifest_key(map_id, version)
        if not self._store.put_new(key, content) and self._store.sha256(key) != version:
            _log.warning("the manifest of version %s of map %s was altered: it is mended", version, map_id)
            self._store.put(key, content)

    def scan(self, map_id: str) -> Iterator[tuple[str, StoredObject]]:
        """Every object of every version of the map, each with its version."""
        for item in self._store.scan(f"maps/{check_map_id(map_id)}/versions"):
            yield item.key.split("/")[3], item

    def remove(self, map_id: str, version: str, keys: list[str]) -> None:
        """The manifest first: without it the version does not exist, whatever happens next."""
        for key in manifest_first(keys):
            self._store.delete(key)
        with self._lock:
            self._manifests.pop((map_id, version), None)


def manifest_first(keys: list[str]) -> list[str]:
    return sorted(keys, key=lambda key: not key.endswith(f"/{FILE_NAME}"))


def _folder(map_id: str, version: str) -> str:
    return f"maps/{check_map_id(map_id)}/versions/{check_version(version)}"


def _manifest_key(map_id: str, version: str) -> str:
    return f"{_folder(map_id, version)}/{FILE_NAME}"
