"""End of a build that made no full version: nothing of it stays but its record.

A provisional version is taken out of service before the end is recorded, as a process that is killed between
the two leaves a build that is run, and ended, again. The sources go afterwards: what a kill leaves of them is
collected as garbage.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from ..builds.records import FINAL_STATES
from ..catalog.catalog import Catalog
from ..errors import NotFound, StoreError, UnreadableRecord
from .garbage import remove_sources_of

_log = logging.getLogger(__name__)


def end_build(catalog: Catalog, build_id: str, status: Mapping[str, Any]) -> None:
    """Record that a build failed or was cancelled, and remove its provisional version and its sources.

    Safe to repeat. What another build needs stays: a source that its record names, and the provisional
    version of a build of the same map that still runs.

    Args:
        status: the final status.

    Raises:
        StoreError: the end is not recorded.
    """
    made_full = _retire_provisional(catalog, build_id, str(status["map_id"]), str(status["state"]))
    catalog.builds.set_status(build_id, status)
    if made_full:  # it was published, but its process was killed before it could say so
        return
    try:
        remove_sources_of(catalog, build_id)
    except StoreError as error:  # garbage collection removes them
        _log.warning("the sources of build %s were not removed: %s", build_id, error)


def _retire_provisional(catalog: Catalog, build_id: str, map_id: str, end: str) -> bool:
    """Take the build's provisional version out of service. Returns whether it has published a full one.

    Args:
        end: how the build ended, for the log.
    """
    if not map_id:
        return False
    state = catalog.state(map_id)
    own = state.published_by(build_id)
    # Two builds may make the same one: the log names the first, and the status of each names it.
    named = {catalog.builds.status_or_queued(build_id)["provisional_version"]}
    for version in (own | named) & state.provisional:
        if not _is_of_another(catalog, build_id, version):
            with suppress(NotFound):  # somebody has just retired it
                catalog.retire(map_id, version, force=True)
                _log.warning(
                    "map %s: its provisional version %s answers no more, as its build %s has %s",
                    map_id,
                    version[:12],
                    build_id,
                    "failed" if end == "failed" else f"been {end}",
                )
    return bool(own - state.provisional)


def _is_of_another(catalog: Catalog, build_id: str, version: str) -> bool:
    """Whether a build that has not ended has published the same provisional version."""
    for other in catalog.builds.ids():
        if other != build_id:
            with suppress(NotFound, UnreadableRecord):
                status = catalog.builds.status(other)
                if status["state"] not in FINAL_STATES and status["provisional_version"] == version:
                    return True
    return False
