"""Versions on the local disk: fetched whole, checked by sha256, and only then visible.

    <directory>/<version>/             the files, once every one of them is verified
    <directory>/.<version>.part/       a download under way, or the rest of one that was killed
    <directory>/.<version>.lock        held while fetching: one download, however many ask
    <directory>/.<version>.verified    size and time of change of every file when it was verified, and since
                                       which start of the machine; its own time is that of the last use

What was verified is on the way to the disk: after a power cut, or any other start of the machine, it is
verified again.

A file store's version is not copied: its files are verified and mapped where they are. What makes room:
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
    """The local folder of a version, every file verified. Safe to call from many threads and processes.

    What was verified since the machine started is read again only if a file's size or time of change differs.

    Args:
        folder: key of the version's folder in the store.
        directory: of the cache; made if missing.

    Raises:
        CorruptVersion: a file is missing or differs from the manifest, in the store itself.
        OutOfSpace: this disk is full.
    """
    directory.mkdir(parents=True, exist_ok=True)
    marker = directory / f".{version}.verified"
    with _full_disk_told(), exclusive_lock(directory / f".{version}.lock"):
        in_place = _folder_in_place(store, folder, manifest)
        if in_place is not None:
            if not _is_verified(marker, manifest, in_place):
                manifest.verify_directory(in_place)
                _mark_verified(marker, manifest, in_place)
            _touch(marker)
            return in_place
        target = directory / version
        if _is_verified(marker, manifest, target):
            _touch(marker)
            return target
        part = directory / f".{version}.part"
        part.mkdir(exist_ok=True)
        for name, entry in manifest.files.items():
            path = part / name
            with suppress(CorruptVersion):  # what a killed download left is kept if it is right
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
        if target.exists():  # it was damaged; whoever has mapped it keeps its files until they are closed
            doomed = directory / f".{version}.{uuid.uuid4().hex}.old"
            target.rename(doomed)
            shutil.rmtree(doomed, ignore_errors=True)
        part.rename(target)
        _mark_verified(marker, manifest, target)
        return target


@contextmanager
def _full_disk_told() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise OutOfSpace("the disk for fetched versions is full") from None


def _folder_in_place(store: Store, folder: str, manifest: Manifest) -> Path | None:
    """The version's folder in a file store; None for other stores."""
    path: Path | None = None
    for name in manifest.files:
        try:
            found = store.local_path(f"{folder}/{name}")
        except NotFound:
            raise CorruptVersion(f"{name} is missing from the store") from None
        if found is None:
            return None
        path = found.parents[name.count("/")]
    return path


def _stamps(manifest: Manifest, folder: Path) -> dict[str, list[int]]:
    stats = {name: (folder / name).stat() for name in manifest.files}
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
    """Of this start of the machine; empty where it is not told."""
    try:
        return _BOOT_ID.read_text().strip()
    except OSError:
        return ""


def _touch(marker: Path) -> None:
    with suppress(OSError):  # somebody else's, or a disk that cannot be written to
        os.utime(marker)
