"""Shared stages: finished stages of builds in the object store, from which any build worker can continue.

    stages/<key>/<sha256>      the stage's files, by content
    stages/<key>/stage.json    name, and {sha256, bytes} of every file; written last
    stages/<key>/before        see ``firstfix_builder.execution.chunks``

The key is a hash of all inputs of the stage (``firstfix_builder.execution.stage_cache``), so a stage never
changes. The results of a stage's chunks are stages of their own. A stage that is put again is compared by its
checksums, and repaired if it differs. A stage without ``stage.json`` does not exist. All of it is a cache
that may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import logging
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import CorruptVersion, FirstfixError, NotFound, TooLarge, UnreadableRecord
from ..ids import check_version
from ..store.json_record import RecordKind, read_record, record_json, text_of, whole_number_of
from ..store.sha256 import sha256_of
from ..store.store import Store

_log = logging.getLogger(__name__)
ROOT = "stages"
RECORD = "stage.json"
DEFAULT_MAX_BYTES = 20 << 30


@dataclass(frozen=True)
class _File:
    name: str
    sha256: str
    bytes: int


class SharedStages:
    """Shared stages of one store. Thread-safe.

    Errors do not fail a build: a stage that cannot be fetched is made, and a stage that cannot be put is not
    shared. The log reports both.

    Args:
        max_bytes: size of the largest stage that is shared.
    """

    def __init__(self, store: Store, *, max_bytes: int = DEFAULT_MAX_BYTES) -> None:
        self._store = store
        self._max_bytes = max_bytes

    def fetch(self, key: str, folder: Path) -> bool:
        """Download a stage's files into an empty folder, each verified by its sha256.

        Returns:
            False if there is no such stage, or it cannot be used. The folder is then empty again.
        """
        try:
            files = self._files(key)
            for file in files:
                self._download(key, file, folder / file.name)
        except NotFound:
            return False
        except (FirstfixError, OSError) as error:
            _log.warning("shared stage %s cannot be used: %s", key[:12], error)
            for path in folder.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            return False
        _log.debug("stage %s fetched: %d bytes", key[:12], sum(file.bytes for file in files))
        return True

    def read(self, key: str) -> dict[str, bytes] | None:
        """Read the files of a small stage by their names, each verified by its sha256.

        Returns:
            None if there is no such stage, or it cannot be used.
        """
        try:
            return {file.name: self._verified(key, file) for file in self._files(key)}
        except NotFound:
            return None
        except (FirstfixError, OSError) as error:
            _log.warning("shared stage %s cannot be used: %s", key[:12], error)
            return None

    def put(self, key: str, name: str, folder: Path) -> int:
        """Share a finished stage if possible. Returns the bytes that were sent."""
        try:
            return self.put_surely(key, name, folder)
        except (FirstfixError, OSError) as error:
            _log.warning("stage %s is not shared: %s", name, error)
            return 0

    def put_surely(self, key: str, name: str, folder: Path) -> int:
        """Share a finished stage that other processes wait for. Returns the bytes that were sent.

        Raises:
            StoreError: the store failed.
            TooLarge: the stage has more than ``max_bytes``.
        """
        sent = 0
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        files = [
            _File(path.relative_to(folder).as_posix(), sha256_of(path), path.stat().st_size) for path in paths
        ]
        total = sum(file.bytes for file in files)
        if total > self._max_bytes:
            raise TooLarge(f"stage {name} has {total} bytes: too large to be shared")
        for path, file in zip(paths, files, strict=True):
            if self._store.put_file(_key(key, file.sha256), path):
                sent += file.bytes
        self._put_record(key, name, files)
        _log.debug("stage %s shared: %d bytes", name, sent)
        return sent

    def put_content(self, key: str, name: str, file_name: str, content: bytes) -> None:
        """Put a small stage of one file, in place of what there is of it.

        Raises:
            StoreError: the store failed.
        """
        file = _File(file_name, hashlib.sha256(content).hexdigest(), len(content))
        self._store.put(_key(key, file.sha256), content)
        self._put_record(key, name, [file])

    def _put_record(self, key: str, name: str, files: Sequence[_File]) -> None:
        """Put the record of a stage after its files. Replaces a damaged record."""
        of_files = {file.name: {"sha256": file.sha256, "bytes": file.bytes} for file in files}
        record = record_json({"stage": name, "files": of_files})
        if not self._store.put_new(_key(key, RECORD), record):
            try:
                self._files(key)
            except (CorruptVersion, UnreadableRecord):
                self._store.put(_key(key, RECORD), record)

    def _files(self, key: str) -> list[_File]:
        """Files in a stage's record.

        Raises:
            NotFound: no such stage.
            UnreadableRecord: the record is damaged, or names a path outside the stage.
            CorruptVersion: the files have more than ``max_bytes`` together.
        """
        where = _key(key, RECORD)
        files = [
            _File(name, entry["sha256"], entry["bytes"])
            for name, entry in read_record(self._store, where, RecordKind.SHARED_STAGE, parse_stage).items()
        ]
        if sum(file.bytes for file in files) > self._max_bytes:
            raise CorruptVersion(f"the files of {where} have more than {self._max_bytes} bytes")
        return files

    def _download(self, stage: str, file: _File, path: Path) -> None:
        """Download one file of a stage and verify it.

        Raises:
            CorruptVersion: the file is missing or damaged. The stage is then removed, so that it is shared
                again once it is made again.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(NotFound):
            if self._store.download(_key(stage, file.sha256), path) == file.sha256:
                return
        raise self._damaged(stage, file)

    def _verified(self, stage: str, file: _File) -> bytes:
        """Read one file of a stage; raises as ``_download`` does."""
        with suppress(NotFound):
            content = self._store.get(_key(stage, file.sha256))
            if hashlib.sha256(content).hexdigest() == file.sha256:
                return content
        raise self._damaged(stage, file)

    def _damaged(self, stage: str, file: _File) -> CorruptVersion:
        """Remove a stage of which a file is missing or damaged."""
        self._store.delete(_key(stage, RECORD))
        self._store.delete(_key(stage, file.sha256))
        return CorruptVersion(f"{file.name} is missing or differs from its sha256")


def parse_stage(record: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Files in a stage's record, with their ``sha256`` and ``bytes``.

    Raises:
        ValueError, KeyError, TypeError, AttributeError, InvalidOption: it is not the record of a stage, or it
            names a path outside the stage.
    """
    files: dict[str, dict[str, Any]] = {}
    text_of(record, "stage", "")
    for name, entry in record["files"].items():
        if PurePosixPath(name).is_absolute() or ".." in name.split("/"):
            raise ValueError("it names a path outside the stage")
        files[name] = {"sha256": check_version(entry["sha256"]), "bytes": whole_number_of(entry, "bytes")}
    return files


@dataclass(frozen=True)
class CollectedStages:
    """Result of ``collect_stages``.

    Attributes:
        removed: keys of the stages.
    """

    removed: tuple[str, ...]
    removed_bytes: int
    kept: int
    kept_bytes: int


def collect_stages(store: Store, older_than_s: float, *, max_bytes: int | None = None) -> CollectedStages:
    """Remove shared stages of this age, then the oldest of the rest until it has at most ``max_bytes``.

    The age is the time since the last put. A build that needs a removed stage makes it again. Several
    processes may collect at the same time.
    """
    cutoff = store.now() - timedelta(seconds=older_than_s)
    sizes: dict[str, int] = {}
    times: dict[str, datetime] = {}
    for item in store.scan(ROOT):
        key = item.key.split("/")[1]
        sizes[key] = sizes.get(key, 0) + item.size_bytes
        times[key] = max(times.get(key, item.last_modified), item.last_modified)
    total, removed = sum(sizes.values()), []
    for key in sorted(times, key=lambda key: times[key]):
        if times[key] > cutoff and (max_bytes is None or total <= max_bytes):
            break
        folder = f"{ROOT}/{key}"
        for name in (
            f"{folder}/{RECORD}",
            *store.list(folder),
        ):  # the record first: without it the stage does not exist
            store.delete(name)
        total -= sizes[key]
        removed.append(key)
    removed_bytes = sum(sizes[key] for key in removed)
    return CollectedStages(tuple(removed), removed_bytes, len(sizes) - len(removed), total)


def _key(stage: str, name: str) -> str:
    return f"{ROOT}/{check_version(stage)}/{name}"
