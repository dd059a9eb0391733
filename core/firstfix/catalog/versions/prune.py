"""Pruning of the cache of versions: the least recently used are removed first."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import time
import uuid
from contextlib import suppress
from pathlib import Path

from .folder_lock import exclusive_lock

ABANDONED_S = 86400.0  # age of a download that nobody continues
_OWN = re.compile(r"\.?([0-9a-f]{64})(\.part|\.verified|\.lock|\.[0-9a-f]{32}\.old)?")
_USUAL = {"", ".verified", ".lock"}  # of a version in the cache


def prune(directory: Path, max_bytes: int) -> list[str]:
    """Remove versions until the cache is within its limit, and what killed processes left.

    Versions that are being fetched or are locked (``FolderLock``) stay, so these can exceed the limit.

    Returns:
        The removed versions.
    """
    if not directory.is_dir():
        return []
    parts: dict[str, list[str]] = {}
    for path in directory.iterdir():
        if match := _OWN.fullmatch(path.name):
            parts.setdefault(match[1], []).append(match[2] or "")
    for name, ends in parts.items():
        if not set(ends) <= _USUAL or "" not in ends:
            _remove_leftovers(directory, name, [end for end in ends if end.endswith(".old")])
    used = {name: _bytes(directory / name) for name in parts if (directory / name).is_dir()}
    total = sum(used.values())
    removed = []
    for name in sorted(used, key=lambda name: _last_use(directory, name)):
        if total <= max_bytes:
            break
        if _remove(directory, name):
            total -= used[name]
            removed.append(name)
    return removed


def _remove(directory: Path, version: str) -> bool:
    """Remove a version. Returns False if it is in use."""
    lock = directory / f".{version}.lock"
    try:
        with exclusive_lock(lock, wait=False):
            folder = directory / version
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                old = directory / f".{version}.{uuid.uuid4().hex}.old"
                folder.rename(old)
            finally:
                os.close(handle)
            shutil.rmtree(old, ignore_errors=True)
            (directory / f".{version}.verified").unlink(missing_ok=True)
            if not (directory / f".{version}.part").exists():
                lock.unlink(missing_ok=True)
    except OSError:  # locked, or another process removes it too
        return False
    return True


def _remove_leftovers(directory: Path, version: str, removed: list[str]) -> None:
    """Remove folders of killed downloads and removals, and the marker and lock of a missing version."""
    lock, marker, part = (directory / f".{version}{end}" for end in (".lock", ".verified", ".part"))
    with suppress(OSError), exclusive_lock(lock, wait=False):
        for end in removed:
            shutil.rmtree(directory / f".{version}{end}", ignore_errors=True)
        if part.is_dir() and time.time() - part.stat().st_mtime > ABANDONED_S:
            shutil.rmtree(part, ignore_errors=True)
        if not part.exists() and not (directory / version).is_dir() and not _stands_elsewhere(marker):
            marker.unlink(missing_ok=True)
            lock.unlink(missing_ok=True)


def _stands_elsewhere(marker: Path) -> bool:
    """Whether a version that was verified in a file store still has a file there."""
    try:
        marked = json.loads(marker.read_bytes())
        return any((Path(marked["folder"]) / name).exists() for name in marked["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _last_use(directory: Path, version: str) -> float:
    for path in (directory / f".{version}.verified", directory / version):
        with suppress(OSError):
            return path.stat().st_mtime
    return 0.0


def _bytes(folder: Path) -> int:
    total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            total += path.lstat().st_size if path.is_file() else 0
    return total
