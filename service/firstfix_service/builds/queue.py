"""The queue of builds as the routes use it: to submit a build and to cancel one."""

from __future__ import annotations

from typing import Any, Protocol

from firstfix.builds.attempts import has_open_attempt
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.maintenance.build_end import end_build


class BuildQueue(Protocol):
    """A queue that runs the builds on record, or hands them to build workers.

    A build is recorded in the store before it is submitted, and each queue also looks for recorded builds
    that have not ended. So a lost submission delays a build and never loses it.
    """

    @property
    def running(self) -> str | None:
        """Id of the build that this process runs now."""

    async def submit(self, build_id: str) -> None:
        """Tells the queue that a new build is on record. Returns at once and raises nothing."""

    async def run(self) -> None:
        """Runs until cancelled. A running build is then stopped, and its next runner resumes it."""


def cancel_build(catalog: Catalog, build_id: str) -> dict[str, Any]:
    """Requests the end of a build, whichever queue has it, and returns its status.

    The request is an object in the store. A runner first claims a build and then looks for a request; this
    function first makes the request and then looks for a runner. So one of them always sees the other. A
    build that nobody runs is ended here.

    Raises:
        NotFound: there is no such build.
        Conflict: the build has ended.
    """
    catalog.request_cancel(build_id)
    status = catalog.build_status(build_id)
    if status["state"] not in FINAL_STATES and not has_open_attempt(catalog.store, build_id):
        status = new_status(
            "cancelled",
            map_id=status["map_id"],
            stage=status["stage"],
            progress=status["progress"],
            provisional_version=status["provisional_version"],
        )
        end_build(catalog, build_id, status)
    return status
