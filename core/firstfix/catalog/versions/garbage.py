"""Garbage of versions: files of retired versions, and of publications that never ended.

Files are removed by generation (``firstfix.catalog.log.map_log``). No publication can use a generation that a
retirement has ended. A publication that never ended could continue at any moment, so the collection first
ends its generation by an entry in the log. If that entry comes before the publication's, the publication puts
its files again, in the next generation. If it would come after it, nothing is removed.
"""

from __future__ import annotations

from datetime import datetime

from ..log.map_log import MapLog
from ..log.map_state import Event, MapState
from .objects import VersionFolder, VersionObjects, manifest_first


def collect_versions(
    map_id: str, seen: MapState, log: MapLog, objects: VersionObjects, cutoff: datetime, *, dry_run: bool
) -> list[str]:
    """Remove the garbage of a map's versions.

    Args:
        seen: state of the map before the files are listed.
        cutoff: time by the store's clock. Versions with newer files or log entries stay.

    Returns:
        The removed keys, or with ``dry_run`` those that would be removed.
    """
    recent = log.changed_since(cutoff)
    removed: list[str] = []
    for folder, items in objects.scan(map_id).items():
        version, has_ended = folder.version, folder.generation < seen.generation(folder.version)
        if version in recent or any(item.last_modified > cutoff for item in items):
            continue
        if version in seen.published and not has_ended:
            continue
        if seen.skipped and not has_ended:  # a lost entry may have published it
            continue
        if dry_run or has_ended or _end_generation(log, folder, seen):
            keys = manifest_first([item.key for item in items])
            if not dry_run:
                objects.remove(folder, keys)
            removed += keys
    return removed


def _end_generation(log: MapLog, folder: VersionFolder, seen: MapState) -> bool:
    """End a generation. Returns False if the log has a newer entry of the version: then keep the files."""

    def needed(state: MapState) -> bool:
        return not any(e.version == folder.version and e.seq > seen.last_seq for e in state.entries)

    return log.append(Event.COLLECTED, folder.version, needed=needed) is not None
