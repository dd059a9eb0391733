"""Asynchronous calls about builds."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any

from ..records import BuildStatus
from .base import AsyncCalls
from .builds import DAY_S


class AsyncBuildCalls(AsyncCalls):
    """Awaitable forms of the calls in ``BuildCalls``. Part of ``AsyncClient``."""

    async def build_map(
        self,
        path: Path | str,
        map_id: str,
        *,
        config: Mapping[str, Any] | None = None,
        trajectory: Path | str | None = None,
        progress: Callable[[BuildStatus], None] | None = None,
        upload_timeout_s: float = 3600.0,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Uploads a map file and starts its build."""
        steps = self._steps.builds.build_map(
            path, map_id, config, trajectory, progress, upload_timeout_s, timeout_s
        )
        return await self._http.run(steps)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> AsyncIterator[BuildStatus]:
        """Yields the recorded builds, newest first."""
        return self._http.iterate(self._steps.builds.builds(map_id, state))

    async def build_status(self, build_id: str) -> BuildStatus:
        """Returns the state of a build."""
        return await self._http.run(self._steps.builds.build_status(build_id))

    def build_events(self, build_id: str, *, timeout_s: float = DAY_S) -> AsyncIterator[BuildStatus]:
        """Yields the build's status whenever it changes."""
        return self._http.iterate(self._steps.builds.build_events(build_id, timeout_s))

    async def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Waits until the build has published its version."""
        return await self._http.run(self._steps.builds.wait_for_build(build_id, progress, timeout_s))

    async def cancel_build(self, build_id: str) -> None:
        """Cancels a build."""
        await self._http.run(self._steps.builds.cancel_build(build_id))
