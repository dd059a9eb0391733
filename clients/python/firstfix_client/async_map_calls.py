"""The asynchronous client's calls about maps and their versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .async_calls import AsyncCalls
from .records import MapInfo, VersionInfo

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


class AsyncMapCalls(AsyncCalls):
    """As ``MapCalls``: the same arguments, results and errors. Part of ``AsyncClient``."""

    async def maps(self) -> list[MapInfo]:
        return [item async for item in self._http.iterate(self._steps.maps.maps())]

    async def show_map(self, map_id: str) -> MapInfo:
        return await self._http.run(self._steps.maps.show_map(map_id))

    async def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        return await self._http.run(self._steps.maps.descriptor_parameters(map_id))

    async def versions(self, map_id: str) -> list[VersionInfo]:
        return [item async for item in self._http.iterate(self._steps.maps.versions(map_id))]

    async def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        return await self._http.run(self._steps.maps.report(map_id, version))

    async def activate(self, map_id: str, version: str) -> None:
        await self._http.run(self._steps.maps.activate(map_id, version))

    async def roll_back(self, map_id: str) -> str:
        return await self._http.run(self._steps.maps.roll_back(map_id))

    async def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        await self._http.run(self._steps.maps.retire(map_id, version, force))

    async def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
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
        await self._http.run(
            self._steps.maps.set_georeference(
                map_id, latitude_deg, longitude_deg, height_m, x_axis_deg, quaternion, anchor_m
            )
        )

    async def georeference(self, map_id: str) -> Mapping[str, Any]:
        return await self._http.run(self._steps.maps.georeference(map_id))

    async def delete_georeference(self, map_id: str) -> None:
        await self._http.run(self._steps.maps.delete_georeference(map_id))
