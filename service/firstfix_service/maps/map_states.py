"""Reads the logs of many maps, in parallel."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_state import MapState
from firstfix.errors import FirstfixError

_log = structlog.get_logger(__name__)
READERS = 16  # logs read at the same time


def read_states(catalog: Catalog, map_ids: Sequence[str], *, strict: bool) -> dict[str, MapState]:
    """Returns the states of maps by their ids.

    Args:
        strict: raise the error of a map that cannot be read, and always read in parallel. Otherwise such a
            map is left out and logged.

    Raises:
        FirstfixError: only if ``strict``.
    """

    def read(map_id: str) -> MapState | None:
        try:
            return catalog.state(map_id)
        except FirstfixError as error:
            if strict:
                raise
            _log.warning("cannot read a map's log", map_id=map_id, code=error.code, error=str(error))
            return None

    if len(map_ids) < READERS and not strict:
        states = [read(map_id) for map_id in map_ids]
    else:
        with ThreadPoolExecutor(READERS, thread_name_prefix="map-reader") as threads:
            states = list(threads.map(read, map_ids))
    return {name: state for name, state in zip(map_ids, states, strict=True) if state is not None}
