"""Asynchronous calls about maps and their versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..records import MapInfo, VersionInfo
from .base import AsyncCalls

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
