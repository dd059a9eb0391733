"""Cache of versions on the local disk. A version is visible only after all its files are verified.

    <directory>/<version>/             files of a verified version
    <directory>/.<version>.part/       a download in progress, or left by a killed process
    <directory>/.<version>.lock        locked while fetching: one download for all processes that ask
    <directory>/.<version>.verified    boot id, and size and change time of every file when it was verified;
    its
                                       own time is that of the last use

Verified files may not have reached the disk yet: so after a power cut, or any other boot, they are verified
again. Those that are right are not fetched again.

A version in a file store is not copied: its files are verified and mapped in place. The cache is pruned by
``firstfix.catalog.versions.prune``.
"""

from __future__ import annotations

import errno
import functools
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ...errors import CorruptVersion, NotFound, OutOfSpace
from ...store.store import Store
from ..manifest import Manifest, verify_file
from .folder_lock import exclusive_lock

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def fetch_version_files(store: Store, folder: str, version: str, manifest: Manifest, directory: Path) -> Path:
    """Fetch a version's files but those for viewers, and verify each. Safe from many threads and processes.

    A version that was verified since boot is read again only if a file's size or change time differs.

    Args:
        folder: key of the version's folder in the store.
        directory: directory of the cache; made if missing.

    Returns:
        The local folder with the files.

    Raises:
        CorruptVersion: a file in the store is missing, or differs from the manifest.
        OutOfSpace: this disk is full.
    """
    directory.mkdir(parents=True, exist_ok=True)
    marker = directory / f".{version}.verified"
    with _full_disk_reported(), exclusive_lock(directory / f".{version}.lock"):
        in_place = _folder_in_place(store, folder, manifest)
        if in_place is not None:
            if not _is_verified(marker, manifest, in_place):
                _verify(manifest, in_place)
                _mark_verified(marker, manifest, in_place)
            _touch(marker)
            return in_place
        target = directory / version
        if _is_right(marker, manifest, target):
            return target
        part = directory / f".{version}.part"
        part.mkdir(exist_ok=True)
        for name, entry in manifest.query_files.items():
            path = part / name
            with suppress(CorruptVersion):  # keep what a killed download left if it is right
                verify_file(path, name, entry)
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                sha256 = store.download(f"{folder}/{name}", path)
            except NotFound:
                raise CorruptVersion(f"{name} is missing from the store") from None
            if sha256 != entry.sha256 or path.stat().st_size != entry.bytes:
                path.unlink()
                raise CorruptVersion(f"{name} in the store differs from its sha256 in the manifest")
        if target.exists():  # damaged; processes that have mapped it keep its files until they close them
            old = directory / f".{version}.{uuid.uuid4().hex}.old"
            target.rename(old)
            shutil.rmtree(old, ignore_errors=True)
        part.rename(target)
        _mark_verified(marker, manifest, target)
        return target


def cached_version(manifest: Manifest, directory: Path) -> Path | None:
    """The folder of a version that was fetched before, without asking a store.

    Args:
        directory: directory of the cache.

    Returns:
        None if the version is not in the cache, or a file of it is missing or damaged.
    """
    version = manifest.digest
    target = directory / version
    if not target.is_dir():
        return None
    with exclusive_lock(directory / f".{version}.lock"):
        return target if _is_right(directory / f".{version}.verified", manifest, target) else None


def check_again(manifest: Manifest, folder: Path, directory: Path) -> None:
    """Read a version's files again although they were verified since boot, because a query failed on them.

    Args:
        folder: the files, in the cache or in a file store.
        directory: directory of the cache.

    Raises:
        CorruptVersion: a file is missing or differs from the manifest. The next fetch then reads all of them.
    """
    marker = directory / f".{manifest.digest}.verified"
    with _full_disk_reported(), exclusive_lock(directory / f".{manifest.digest}.lock"):
        marker.unlink(missing_ok=True)
        _verify(manifest, folder)
        _mark_verified(marker, manifest, folder)


@contextmanager
def _full_disk_reported() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise OutOfSpace("the disk for fetched versions is full") from None


def _folder_in_place(store: Store, folder: str, manifest: Manifest) -> Path | None:
    """Folder of a version in a file store; None for other stores."""
    path: Path | None = None
    for name in manifest.query_files:
        try:
            found = store.local_path(f"{folder}/{name}")
        except NotFound:
            raise CorruptVersion(f"{name} is missing from the store") from None
        if found is None:
            return None
        path = found.parents[name.count("/")]
    return path


def _is_right(marker: Path, manifest: Manifest, target: Path) -> bool:
    """Whether a fetched folder has the version's files. They are read if they were not since boot."""
    if not target.is_dir():
        return False
    if not _is_verified(marker, manifest, target):
        try:
            _verify(manifest, target)
        except CorruptVersion:
            return False
        _mark_verified(marker, manifest, target)
    _touch(marker)
    return True


def _verify(manifest: Manifest, folder: Path) -> None:
    """Read the files that queries need.

    Raises:
        CorruptVersion: one is missing, or differs from the manifest.
    """
    for name, entry in manifest.query_files.items():
        verify_file(folder / name, name, entry)


def _stamps(manifest: Manifest, folder: Path) -> dict[str, list[int]]:
    stats = {name: (folder / name).stat() for name in manifest.query_files}
    return {name: [stat.st_size, stat.st_mtime_ns, stat.st_ino] for name, stat in stats.items()}


def _is_verified(marker: Path, manifest: Manifest, folder: Path) -> bool:
    try:
        return bool(json.loads(marker.read_bytes()) == _marker_of(manifest, folder))
    except (OSError, ValueError):
        return False


def _mark_verified(marker: Path, manifest: Manifest, folder: Path) -> None:
    part = marker.with_name(f"{marker.name}.{uuid.uuid4().hex}.part")
    part.write_text(json.dumps(_marker_of(manifest, folder)))
    part.replace(marker)


def _marker_of(manifest: Manifest, folder: Path) -> dict[str, Any]:
    return {"boot": _boot_id(), "folder": str(folder), "files": _stamps(manifest, folder)}


@functools.cache
def _boot_id() -> str:
    """Id of this boot of the machine; empty if the system does not provide one."""
    try:
        return _BOOT_ID.read_text().strip()
    except OSError:
        return ""


def _touch(marker: Path) -> None:
    with suppress(OSError):  # another user's file, or a read-only disk
        os.utime(marker)
