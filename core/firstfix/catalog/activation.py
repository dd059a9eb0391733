"""Choice of the version that a map serves: activation, rollback and retirement of published versions."""

from __future__ import annotations

from ..errors import Conflict, NotFound
from .log.map_log import MapLog
from .log.map_state import Event, MapState


def check_published(map_id: str, version: str, state: MapState) -> None:
    """Check that a version can be served.

    Raises:
        NotFound: the map has no such version, or it was retired.
    """
    if version not in state.published:
        if not state.exists:
            raise NotFound.of_map(map_id)
        raise NotFound(f"map {map_id} has no version {version}")


def activate(map_id: str, log: MapLog, version: str) -> bool:
    """Activate a published version. Returns False if it is active already.

    Raises:
        NotFound: the map has no such version, or it was retired.
    """

    def is_needed(state: MapState) -> bool:
        check_published(map_id, version, state)
        return state.active != version

    return log.append(Event.ACTIVATED, version, needed=is_needed) is not None


def version_before(map_id: str, state: MapState) -> str:
    """Version that was active before the active one.

    Raises:
        NotFound: no such map.
        Conflict: no version was active before.
    """
    if not state.exists:
        raise NotFound.of_map(map_id)
    if len(state.activated) < 2:
        raise Conflict(f"map {map_id} has no version that was active before")
    return state.activated[1]


def roll_back(map_id: str, log: MapLog, before: MapState) -> None:
    """Activate the version that was active before, if the map's activations are still those of a state.

    Raises:
        Conflict: another version was activated meanwhile.
    """

    def is_needed(state: MapState) -> bool:
        if state.activated != before.activated:
            raise Conflict(f"the active version of map {map_id} has just changed: look again")
        return True

    log.append(Event.ACTIVATED, version_before(map_id, before), needed=is_needed)


def retire(map_id: str, log: MapLog, version: str, *, force: bool) -> None:
    """Take a version out of service. With ``force`` also the active one.

    Raises:
        NotFound: the map has no such version, or it was retired.
        Conflict: it is the active one, and not ``force``.
    """

    def is_needed(state: MapState) -> bool:
        check_published(map_id, version, state)
        if version == state.active and not force:
            raise Conflict(f"version {version} of map {map_id} is active: activate another one first")
        return True

    log.append(Event.RETIRED, version, needed=is_needed)
