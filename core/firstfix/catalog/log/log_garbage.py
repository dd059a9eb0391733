"""Garbage of logs: entries that are summed up in snapshots, and notices that all readers have read.

Enough stays to read a log even if one snapshot is damaged: the newest ``KEPT`` readable snapshots, and all
entries after the second newest of them. The newest entry always stays, so that a reader that was stopped for
long sees that the log has grown.
"""

from __future__ import annotations

from datetime import datetime

from ...store.numbered import scan_after
from ...store.store import Store, StoredObject
from .change_log import DIGITS, FOLDER, MARKS
from .map_log import read_snapshot, snapshots_of

KEPT = 3  # snapshots


def log_garbage(store: Store, folder: str, cutoff: datetime) -> list[str]:
    """Keys of garbage in one map's log, older than a time: entries and snapshots.

    Args:
        folder: folder of the log's entries.
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
    garbage = [item for number, item in snapshots.items() if number < kept[-1]]
    garbage += [
        item
        for number, item in scan_after(store, folder, 0).items()
        if number <= kept[1] and number not in skipped  # people may want to look at damaged entries
    ]
    return _older(garbage, cutoff)


def change_garbage(store: Store, cutoff: datetime) -> list[str]:
    """Keys of garbage among notices and marks, older than a time."""
    marks = scan_after(store, MARKS, 0, digits=DIGITS)
    if len(marks) < 2:
        return []
    floor = list(marks)[-2]
    garbage = [item for number, item in marks.items() if number < floor]
    notices = scan_after(store, FOLDER, 0, digits=DIGITS)
    return _older([*garbage, *(item for number, item in notices.items() if number <= floor)], cutoff)


def _older(items: list[StoredObject], cutoff: datetime) -> list[str]:
    return [item.key for item in items if item.last_modified < cutoff]
