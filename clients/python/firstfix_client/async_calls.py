"""Asynchronous calls about maps, their versions and builds."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .calls import DAY_S, AsyncCalls
from .records import BuildStatus, MapInfo, VersionInfo

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


class AsyncMapCalls(AsyncCalls):
    """Awaitable forms of the calls in ``MapCalls``. Part of ``AsyncClient``."""

    async def maps(self) -> list[MapInfo]:
        """Returns the maps that the service can localize in."""
        return [item async for item in self._http.iterate(self._steps.maps.maps())]

    async def show_map(self, map_id: str) -> MapInfo:
        """Returns one map."""
        return await self._http.run(self._steps.maps.show_map(map_id))

    async def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        """Returns the parameters with which a robot describes scans for the active version."""
        return await self._http.run(self._steps.maps.descriptor_parameters(map_id))

    async def versions(self, map_id: str) -> list[VersionInfo]:
        """Returns the versions of a map, newest first."""
        return [item async for item in self._http.iterate(self._steps.maps.versions(map_id))]

    async def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """Returns the self-test report of a version, as the service's JSON."""
        return await self._http.run(self._steps.maps.report(map_id, version))

    async def changes(
        self, map_id: str, version: str | None = None, *, cells: bool = False, grid: bool = False
    ) -> Mapping[str, Any]:
        """Returns the areas that have changed since the map was made, as the service's JSON."""
        return await self._http.run(self._steps.maps.changes(map_id, version, cells, grid))

    async def activate(self, map_id: str, version: str) -> None:
        """Makes a published version the active one."""
        await self._http.run(self._steps.maps.activate(map_id, version))

    async def roll_back(self, map_id: str) -> str:
        """Makes the previously active version active again, and returns it."""
        return await self._http.run(self._steps.maps.roll_back(map_id))

    async def patch(self, map_id: str, mode: str | None = None) -> str:
        """Asks for a patch of the active version by what kept queries have seen. Returns the build's id."""
        return await self._http.run(self._steps.maps.patch(map_id, mode))

    async def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Takes a version out of service."""
        await self._http.run(self._steps.maps.retire(map_id, version, force))

    async def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Removes unreferenced objects. Returns counts by kind."""
        return await self._http.run(self._steps.maps.collect_garbage(map_id, dry_run))

    async def set_georeference(
        self,
        map_id: str,
        *,
        latitude_deg: float,
        longitude_deg: float,
        height_m: float,
        x_axis_deg: float | None = None,
        quaternion: Sequence[float] | None = None,
        anchor_m: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Sets the map's position and orientation on the Earth (WGS84)."""
        await self._http.run(
            self._steps.maps.set_georeference(
                map_id, latitude_deg, longitude_deg, height_m, x_axis_deg, quaternion, anchor_m
            )
        )

    async def georeference(self, map_id: str) -> Mapping[str, Any]:
        """Returns the map's georeference, as the service's JSON."""
        return await self._http.run(self._steps.maps.georeference(map_id))

    async def delete_georeference(self, map_id: str) -> None:
        """Removes the map's georeference."""
        await self._http.run(self._steps.maps.delete_georeference(map_id))


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
