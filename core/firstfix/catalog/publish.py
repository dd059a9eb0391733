"""Publication of a version: its files first, then its manifest, then the entry in the map's log.

Repeating it after a kill at any point completes it. A garbage collection of the version at the same time does
no harm: either the collection sees the publication, or the publication sees the collection and puts the files
again, in the next generation (``firstfix.catalog.log.map_log``).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from ..errors import StoreUnavailable
from .log.map_log import MapLog
from .log.map_state import Event, MapState
from .manifest import Manifest
from .provenance import Provenance, summary_of
from .versions.objects import VersionFolder, VersionObjects

_MAX_COLLECTIONS = 5  # that interrupt one publication


class _Collected(Exception):
    """The files that a publication has put are being removed."""


def publish_and_activate(
    map_id: str,
    log: MapLog,
    objects: VersionObjects,
    directory: Path,
    manifest: Manifest,
    *,
    activate: bool,
    build_id: str,
    provenance: Provenance,
    on_progress: Callable[[float], None],
) -> bool:
    """Publish a version and, if it is to be, activate it. Returns whether the log has a new entry.

    A provisional version is neither published nor activated once the map has a full one. It is retired then,
    so that garbage collection removes it.

    Arguments and errors are those of ``Catalog.publish``.
    """
    version = manifest.digest

    def is_too_late(state: MapState) -> bool:
        return manifest.provisional and state.has_full

    def is_done(event: Event, state: MapState) -> bool:
        return bool(build_id) and any(
            (e.event, e.version, e.build_id) == (event, version, build_id) for e in state.entries
        )

    if is_too_late(log.state()):
        return False
    for _ in range(_MAX_COLLECTIONS):
        generation = log.state().generation(version)
        objects.put(VersionFolder(map_id, version, generation), directory, manifest, on_progress)

        def is_needed(state: MapState, generation: int = generation) -> bool:
            if version in state.published or is_done(Event.PUBLISHED, state) or is_too_late(state):
                return False
            if state.generation(version) != generation:
                raise _Collected
            return True

        with suppress(_Collected):
            published = log.append(
                Event.PUBLISHED,
                version,
                build_id=build_id,
                generation=generation,
                provisional=manifest.provisional,
                provenance=provenance.to_mapping(),
                summary=summary_of(manifest),
                needed=is_needed,
            )
            break
    else:
        raise StoreUnavailable(f"garbage collections remove version {version} of map {map_id} repeatedly")
    written = [published]
    if activate:
        is_wanted = partial(_is_wanted, version, is_done, is_too_late)
        written.append(log.append(Event.ACTIVATED, version, build_id=build_id, needed=is_wanted))
    if not manifest.provisional:
        for provisional in sorted(log.state().provisional):
            is_over = partial(_is_over, provisional, activate)
            written.append(log.append(Event.RETIRED, provisional, build_id=build_id, needed=is_over))
    return any(entry is not None for entry in written)


def _is_wanted(
    version: str,
    is_done: Callable[[Event, MapState], bool],
    is_too_late: Callable[[MapState], bool],
    state: MapState,
) -> bool:
    """Whether a version is to be activated, and was not yet."""
    if version not in state.published or version == state.active:
        return False
    return not is_done(Event.ACTIVATED, state) and not is_too_late(state)


def _is_over(version: str, full_is_activated: bool, state: MapState) -> bool:
    """Whether a provisional version is still published, and another one active or not to be."""
    return version in state.published and (version != state.active or not full_is_activated)
