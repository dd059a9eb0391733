"""What the routes know of the queue of builds, whichever it is."""

from __future__ import annotations

from typing import Protocol


class BuildQueue(Protocol):
    """Builds are on record in the store before they are submitted, and every queue looks for what is on
    record and not ended: a submission that is lost costs time, never a build.

    To cancel a build is no matter of its queue: see ``cancel_build``.
    """

    @property
    def running(self) -> str | None:
        """The build that runs in this process's care."""

    async def submit(self, build_id: str) -> None:
        """There is a new build on record. Returns soon and raises nothing, whatever is out of reach."""

    async def run(self) -> None:
        """Until it is cancelled; then a running build is stopped, to be resumed by whoever takes it next."""
