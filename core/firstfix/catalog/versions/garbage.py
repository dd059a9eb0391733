"""Files of versions that nobody can see: of retired ones, and of publishes that never ended.

They are removed by generation (``log.map_log``). One that a retirement has ended no publish can name any
more. One that a publish left which never ended may be gone on with at any moment: so the log says first that
it is over. Either that entry comes before the publish's, which then puts its files into the next generation,
or after it, and nothing is removed.
"""

from __future__ import annotations

from datetime import datetime

from ..log.map_log import MapLog
from ..log.map_state import Event, MapState
from .objects import VersionFolder, VersionObjects, manifest_first


def collect_versions(
    map_id: str, seen: MapState, log: MapLog, objects: VersionObjects, cutoff: datetime, *, dry_run: bool
) -> list[str]:
    """The keys that were removed, or with ``dry_run`` would be.

    Args:
        seen: what the log added up to before.
        cutoff: of the store's clock; what was put since stays, and versions that the log speaks of since.
    """
    recent = log.changed_since(cutoff)
    removed: list[str] = []
    for folder, items in objects.scan(map_id).items():
        version, has_ended = folder.version, folder.generation < seen.generation(folder.version)
        if version in recent or any(item.last_modified > cutoff for item in items):
            continue
        if version in seen.published and not has_ended:
            continue
        if seen.skipped and not has_ended:  # an entry that is lost may have published it
            continue
        if dry_run or has_ended or _give_up(log, folder, seen):
            keys = manifest_first([item.key for item in items])
            if not dry_run:
                objects.remove(folder, keys)
            removed += keys
    return removed


def _give_up(log: MapLog, folder: VersionFolder, seen: MapState) -> bool:
    """Ends the generation, unless the log speaks of the version since. False: it is not to be removed."""

    def needed(state: MapState) -> bool:
        return not any(e.version == folder.version and e.seq > seen.last_seq for e in state.entries)

    return log.append(Event.COLLECTED, folder.version, needed=needed) is not None
