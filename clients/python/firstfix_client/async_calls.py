"""Calls of the asynchronous client: scripts/generate.py makes them of calls.py."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import InvalidOption
from firstfix.scan.sequence import ScanSequence

from .records import BuildStatus, MapInfo, VersionInfo
from .steps.localize import options_of
from .steps.scan_body import BodyForm, Encoding, ScanLike

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters

    from .drivers.async_http import AsyncService


C = TypeVar("C", bound="AsyncHttpCalls")


class AsyncHttpCalls:
    """Base of the groups of calls."""

    _service: AsyncService | None

    @property
    def _http(self) -> AsyncService:
        if self._service is None:
            raise InvalidOption("this call goes over HTTP: give ZenohClient the url of the service")
        return self._service

    async def __aenter__(self: C) -> C:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.close()


class AsyncFixCalls(AsyncHttpCalls):
    """Queries for the pose of a scan."""

    async def localize(
        self,
        scan: ScanLike | ScanSequence,
        *,
        map_id: str,
        prior: Prior | None = None,
        gravity: ArrayLike | None = None,
        options: LocalizeOptions | None = None,
        encoding: Encoding = "scan",
        parameters: DescriptorParameters | None = None,
        robot: str | None = None,
    ) -> Localization:
        """The pose of a scan in a map, or why there is none."""
        form = BodyForm(encoding, parameters)
        return await self._http.run(
            self._http.steps.fixes.localize(scan, map_id, options_of(options, prior, gravity), form, robot)
        )

    async def localize_body(
        self,
        body: bytes,
        media_type: str,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
        content_encoding: str | None = None,
        request_id: str | None = None,
        robot: str | None = None,
    ) -> Localization:
        """The answer to an encoded query, as ``localize`` does. The bytes are sent unchanged."""
        return await self._http.run(
            self._http.steps.ask(
                body, media_type, map_id, options or LocalizeOptions(), robot, content_encoding, request_id
            )
        )


class AsyncMapCalls(AsyncHttpCalls):
    """Calls about maps, versions and georeferences."""

    async def maps(self) -> list[MapInfo]:
        """The maps that the service can localize in."""
        return [item async for item in self._http.items(self._http.steps.maps.maps())]

    async def show_map(self, map_id: str) -> MapInfo:
        """One map."""
        return await self._http.run(self._http.steps.maps.show_map(map_id))

    async def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        """The parameters with which a robot describes scans for the map's active version."""
        return await self._http.run(self._http.steps.maps.descriptor_parameters(map_id))

    async def versions(self, map_id: str) -> list[VersionInfo]:
        """The versions of a map, newest first."""
        return [item async for item in self._http.items(self._http.steps.maps.versions(map_id))]

    async def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """The self-test report of a version, as the service's JSON."""
        return await self._http.run(self._http.steps.maps.report(map_id, version))

    async def changes(
        self, map_id: str, version: str | None = None, *, cells: bool = False, grid: bool = False
    ) -> Mapping[str, Any]:
        """The areas that have changed since the map was made, as the service's JSON."""
        return await self._http.run(self._http.steps.maps.changes(map_id, version, cells, grid))

    async def activate(self, map_id: str, version: str) -> None:
        """Make a published version the active one, which answers queries."""
        await self._http.run(self._http.steps.maps.activate(map_id, version))

    async def roll_back(self, map_id: str) -> str:
        """Make the previously active version active again, and return it."""
        return await self._http.run(self._http.steps.maps.roll_back(map_id))

    async def patch(self, map_id: str, mode: str | None = None) -> str:
        """Ask for a patch of the active version by what recorded queries saw. Returns the build's id."""
        return await self._http.run(self._http.steps.maps.patch(map_id, mode))

    async def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Take a version out of service."""
        await self._http.run(self._http.steps.maps.retire(map_id, version, force))

    async def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Remove unreferenced objects of one map, or of the whole store. Returns counts by kind."""
        return await self._http.run(self._http.steps.maps.collect_garbage(map_id, dry_run))

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
        """Set the map's position and orientation on the Earth (WGS84)."""
        await self._http.run(
            self._http.steps.maps.set_georeference(
                map_id, latitude_deg, longitude_deg, height_m, x_axis_deg, quaternion, anchor_m
            )
        )

    async def georeference(self, map_id: str) -> Mapping[str, Any]:
        """The map's georeference, as the service's JSON."""
        return await self._http.run(self._http.steps.maps.georeference(map_id))

    async def delete_georeference(self, map_id: str) -> None:
        """Remove the map's georeference."""
        await self._http.run(self._http.steps.maps.delete_georeference(map_id))


DAY_S = 24 * 3600.0


class AsyncBuildCalls(AsyncHttpCalls):
    """Calls about uploads and builds."""

    async def build_map(
        self,
        path: Path | str,
        map_id: str,
        *,
        config: Mapping[str, Any] | None = None,
        trajectory: Path | str | None = None,
        note: str = "",
        progress: Callable[[BuildStatus], None] | None = None,
        upload_timeout_s: float = 3600.0,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Upload a map file and start its build."""
        steps = self._http.steps.builds.build_map(
            path, map_id, config, trajectory, note, progress, upload_timeout_s, timeout_s
        )
        return await self._http.run(steps)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> AsyncIterator[BuildStatus]:
        """Yield the recorded builds, newest first. Pages are fetched as they are needed."""
        return self._http.items(self._http.steps.builds.builds(map_id, state))

    async def build_status(self, build_id: str) -> BuildStatus:
        """The state of a build."""
        return await self._http.run(self._http.steps.builds.build_status(build_id))

    def build_events(self, build_id: str, *, timeout_s: float = DAY_S) -> AsyncIterator[BuildStatus]:
        """Yield the build's status whenever it changes; the last one is final."""
        return self._http.items(self._http.steps.builds.build_events(build_id, timeout_s))

    async def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Wait until the build has published its version; calls ``progress`` about once a second."""
        return await self._http.run(self._http.steps.builds.wait_for_build(build_id, progress, timeout_s))

    async def cancel_build(self, build_id: str) -> None:
        """Cancel a build. It stops a moment later."""
        await self._http.run(self._http.steps.builds.cancel_build(build_id))
