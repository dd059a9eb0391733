"""Garbage of logs: entries that snapshots have summed up, notices that everybody has read.

What is left is enough to read a log although one snapshot is damaged: the newest ``KEPT`` snapshots that can
be read, and all entries after the second newest of them. The newest entry is always left, so that a reader
that was stopped for long sees that the log went on.
"""

from __future__ import annotations

from datetime import datetime

from ...store.numbered import scan_after
from ...store.store import Store, StoredObject
from .change_log import DIGITS, FOLDER, MARKS
from .map_log import MapLog, read_snapshot, snapshots_of

KEPT = 3  # snapshots


def log_garbage(store: Store, folder: str, cutoff: datetime) -> list[str]:
    """Keys of one map's log that are garbage and older than a time: entries and snapshots.

    Args:
        folder: of the log's entries.
    """
    snapshots = scan_after(store, snapshots_of(folder), 0)
    kept: list[int] = []
    skipped: set[int] = set()
    for number in reversed(snapshots):
        if len(kept) < KEPT and (state := read_snapshot(store, snapshots_of(folder), number)) is not None:
            kept.append(number)
            skipped.update(state.skipped)
    if len(kept) < KEPT:
        return []
    doomed = [item for number, item in snapshots.items() if number < kept[-1]]
    doomed += [
        item
        for number, item in scan_after(store, folder, 0).items()
        if number <= kept[1] and number not in skipped  # what could not be read is left for people
    ]
    return _older(doomed, cutoff)


def leave_snapshot(store: Store, folder: str) -> None:
    """A snapshot of a log that has many entries and none, or none of late."""
    MapLog(store, folder).leave_snapshot()


def change_garbage(store: Store, cutoff: datetime) -> list[str]:
    """Keys of notices and marks that are garbage and older than a time."""
    marks = scan_after(store, MARKS, 0, digits=DIGITS)
    if len(marks) < 2:
        return []
    floor = list(marks)[-2]
    doomed = [item for number, item in marks.items() if number < floor]
    notices = scan_after(store, FOLDER, 0, digits=DIGITS)
    return _older([*doomed, *(item for number, item in notices.items() if number <= floor)], cutoff)


def _older(items: list[StoredObject], cutoff: datetime) -> list[str]:
    return [item.key for item in items if item.last_modified < cutoff]
