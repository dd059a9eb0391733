"""Stopping a build, wherever it waits or runs: the wish is an object in the store."""

from __future__ import annotations

from typing import Any

from firstfix.builds.attempts import is_held
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog


def cancel_build(catalog: Catalog, build_id: str) -> dict[str, Any]:
    """Asks the build to stop, and records the end of one that nobody runs. Its status.

    Whoever takes a build looks for the wish after it has the build, and this looks for a holder after
    the wish is there: so one of both sees the other.

    Raises:
        NotFound: no such build.
        Conflict: it has ended.
    """
    catalog.request_cancel(build_id)
    status = catalog.build_status(build_id)
    if status["state"] not in FINAL_STATES and not is_held(catalog.store, build_id):
        status = new_status("cancelled", map_id=status["map_id"], stage=status["stage"])
        catalog.set_build_status(build_id, status)
    return status
