"""Publication of a version: its files first, then its manifest, then the entry in the map's log.

Repeating it after a kill at any point completes it. A garbage collection of the version at the same time does
no harm: either the collection sees the publication, or the publication sees the collection and puts the files
again, in the next generation (``firstfix.catalog.log.map_log``).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..errors import StoreUnavailable
from .log.map_log import MapLog
from .log.map_state import Event, MapState
from .manifest import Manifest
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
    build_id: str,
    on_progress: Callable[[float], None],
) -> bool:
    """Publish a version and activate it. Returns whether the log has a new entry.

    Arguments and errors are those of ``Catalog.publish``.
    """
    version = manifest.digest

    def is_done(event: Event, state: MapState) -> bool:
        return bool(build_id) and any(
            (e.event, e.version, e.build_id) == (event, version, build_id) for e in state.entries
        )

    for _ in range(_MAX_COLLECTIONS):
        generation = log.state().generation(version)
        objects.put(VersionFolder(map_id, version, generation), directory, manifest, on_progress)

        def is_needed(state: MapState, generation: int = generation) -> bool:
            if version in state.published or is_done(Event.PUBLISHED, state):
                return False
            if state.generation(version) != generation:
                raise _Collected
            return True

        with suppress(_Collected):
            published = log.append(
                Event.PUBLISHED, version, build_id=build_id, generation=generation, needed=is_needed
            )
            break
    else:
        raise StoreUnavailable(f"garbage collections remove version {version} of map {map_id} repeatedly")
    activated = log.append(
        Event.ACTIVATED,
        version,
        build_id=build_id,
        needed=lambda state: (
            version in state.published and version != state.active and not is_done(Event.ACTIVATED, state)
        ),
    )
    return published is not None or activated is not None
