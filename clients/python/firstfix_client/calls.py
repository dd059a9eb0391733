"""Calls of the blocking client. scripts/generate.py makes those of the asynchronous client of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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

    from .drivers.blocking_http import BlockingService


C = TypeVar("C", bound="HttpCalls")


class HttpCalls:
    """Base of the groups of calls."""

    _service: BlockingService | None

    @property
    def _http(self) -> BlockingService:
        if self._service is None:
            raise InvalidOption("this call goes over HTTP: give ZenohClient the url of the service")
        return self._service

    def __enter__(self: C) -> C:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()


class FixCalls(HttpCalls):
    """Queries for the pose of a scan."""

    def localize(
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
        """The pose of a scan in a map, or why there is none.

        "Not localized" is an answer without a pose, not an error.

        Args:
            scan: a Scan, (n, 3) points in metres in the sensor frame, the path of a scan file, or several
                scans with the motion between them. The pose is then that of the last scan.
            map_id: one map; several, separated by commas; or empty for all maps that are served. The best
                place in any of them wins.
            prior: where the robot is known to be.
            gravity: (3,) direction of gravity in the sensor frame (pointing down).
            options: everything that can be asked; ``prior`` and ``gravity`` replace its fields. Without a
                ``deadline_ms`` the service is told how long this client waits.
            encoding: ``range_image`` sends the whole scan in a ninth to a third of the bytes, 120k points
                in under 90 KB. ``compact`` sends under 10 KB and localizes as well as the whole scan.
                ``descriptor`` sends under 1.5 KB and gets candidates, never ``localized``.
            parameters: the map's, for the last two. A descriptor needs those of its one map. If they are
                not given, the client asks the service for them once, and again when the map changes.
            robot: its name, for people who watch the answers of robots that share a key or an address.

        Raises:
            NotFound: no such map or version, or no such file.
            InputError: the scan or an option cannot be used.
        """
        form = BodyForm(encoding, parameters)
        return self._http.run(
            self._http.steps.fixes.localize(scan, map_id, options_of(options, prior, gravity), form, robot)
        )

    def localize_body(
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
        """The answer to an encoded query, as ``localize`` does. The bytes are sent unchanged.

        Args:
            media_type, content_encoding: format of the bytes, see clients/PROTOCOL.md.
            request_id: id of the query in the service's log.
            robot: its name, as in ``localize``.
        """
        return self._http.run(
            self._http.steps.ask(
                body, media_type, map_id, options or LocalizeOptions(), robot, content_encoding, request_id
            )
        )


class MapCalls(HttpCalls):
    """Calls about maps, versions and georeferences."""

    def maps(self) -> list[MapInfo]:
        """The maps that the service can localize in."""
        return list(self._http.items(self._http.steps.maps.maps()))

    def show_map(self, map_id: str) -> MapInfo:
        """One map.

        Raises:
            NotFound: no such map.
        """
        return self._http.run(self._http.steps.maps.show_map(map_id))

    def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        """The parameters with which a robot describes scans for the map's active version.

        Raises:
            NotFound: no such map, or no version of it is active.
            UnsupportedFormat: this client cannot compute the version's descriptor.
        """
        return self._http.run(self._http.steps.maps.descriptor_parameters(map_id))

    def versions(self, map_id: str) -> list[VersionInfo]:
        """The versions of a map, newest first.

        Raises:
            NotFound: no such map.
        """
        return list(self._http.items(self._http.steps.maps.versions(map_id)))

    def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """The self-test report of a version, as the service's JSON.

        Raises:
            NotFound: no such map or version.
        """
        return self._http.run(self._http.steps.maps.report(map_id, version))

    def changes(
        self, map_id: str, version: str | None = None, *, cells: bool = False, grid: bool = False
    ) -> Mapping[str, Any]:
        """The areas that have changed since the map was made, as the service's JSON.

        Args:
            version: default: the active version.
            cells: list the cells of each area.
            grid: list the counts of all cells.

        Raises:
            NotFound: no such map or version.
        """
        return self._http.run(self._http.steps.maps.changes(map_id, version, cells, grid))

    def activate(self, map_id: str, version: str) -> None:
        """Make a published version the active one, which answers queries.

        Raises:
            NotFound: no such map or version.
        """
        self._http.run(self._http.steps.maps.activate(map_id, version))

    def roll_back(self, map_id: str) -> str:
        """Make the previously active version active again, and return it.

        Raises:
            NotFound: no such map.
            Conflict: no version was active before.
        """
        return self._http.run(self._http.steps.maps.roll_back(map_id))

    def patch(self, map_id: str, mode: str | None = None) -> str:
        """Ask for a patch of the active version by what recorded queries saw. Returns the build's id.

        Args:
            mode: ``propose``: the patched version waits until somebody activates it; ``activate``: it is
                activated, unless it is worse; None: as the map's build config says.

        Raises:
            NotFound: no such map, or its sources are gone.
            Conflict: patches of the map are off and no mode is given, or its version is provisional.
        """
        return self._http.run(self._http.steps.maps.patch(map_id, mode))

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Take a version out of service.

        Args:
            force: also if it is the active version; the previously active one then answers.

        Raises:
            NotFound: no such map or version.
            Conflict: it is the active version, and ``force`` is not set.
        """
        self._http.run(self._http.steps.maps.retire(map_id, version, force))

    def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Remove unreferenced objects of one map, or of the whole store. Returns counts by kind."""
        return self._http.run(self._http.steps.maps.collect_garbage(map_id, dry_run))

    def set_georeference(
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
        """Set the map's position and orientation on the Earth (WGS84).

        Args:
            latitude_deg, longitude_deg, height_m: the anchor's; the height is above the ellipsoid.
            x_axis_deg: direction of the map's x axis, counter-clockwise from east; or
            quaternion: (x, y, z, w) that rotates map axes into east, north, up.
            anchor_m: (3,) a point in map coordinates.

        Raises:
            NotFound: no such map.
            InvalidOption: a value is out of its range.
        """
        self._http.run(
            self._http.steps.maps.set_georeference(
                map_id, latitude_deg, longitude_deg, height_m, x_axis_deg, quaternion, anchor_m
            )
        )

    def georeference(self, map_id: str) -> Mapping[str, Any]:
        """The map's georeference, as the service's JSON.

        Raises:
            NotFound: no such map, or it has no georeference.
        """
        return self._http.run(self._http.steps.maps.georeference(map_id))

    def delete_georeference(self, map_id: str) -> None:
        """Remove the map's georeference.

        Raises:
            NotFound: no such map, or it has no georeference.
        """
        self._http.run(self._http.steps.maps.delete_georeference(map_id))


DAY_S = 24 * 3600.0


class BuildCalls(HttpCalls):
    """Calls about uploads and builds."""

    def build_map(
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
        """Upload a map file and start its build.

        One build is started, however often the connection breaks. Files of 64 MiB and more are sent in
        parts; a part that arrived is not sent again.

        Args:
            config: build config, with the keys of its YAML file; None: the service's defaults.
            trajectory: file with the poses of the mapping run.
            note: for people, shown with the version.
            progress: called about once a second until the build ends. None: do not wait for the build;
                follow it with ``wait_for_build`` or ``build_events``.
            timeout_s: limit for the build itself, if it is waited for.

        Raises:
            NotFound: no such file.
            InputError: the service cannot use the file or the config.
            BuildFailed, BuildCancelled: the build ended without a version.
        """
        steps = self._http.steps.builds.build_map(
            path, map_id, config, trajectory, note, progress, upload_timeout_s, timeout_s
        )
        return self._http.run(steps)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> Iterator[BuildStatus]:
        """Yield the recorded builds, newest first. Pages are fetched as they are needed."""
        return self._http.items(self._http.steps.builds.builds(map_id, state))

    def build_status(self, build_id: str) -> BuildStatus:
        """The state of a build.

        Raises:
            NotFound: no such build.
        """
        return self._http.run(self._http.steps.builds.build_status(build_id))

    def build_events(self, build_id: str, *, timeout_s: float = DAY_S) -> Iterator[BuildStatus]:
        """Yield the build's status whenever it changes; the last one is final.

        Raises:
            NotFound: no such build.
            DeadlineExceeded: the build has not ended yet; it goes on.
        """
        return self._http.items(self._http.steps.builds.build_events(build_id, timeout_s))

    def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Wait until the build has published its version; calls ``progress`` about once a second.

        Raises:
            BuildFailed, BuildCancelled: the build ended without a version.
            DeadlineExceeded: the build has not ended yet; it goes on.
        """
        return self._http.run(self._http.steps.builds.wait_for_build(build_id, progress, timeout_s))

    def cancel_build(self, build_id: str) -> None:
        """Cancel a build. It stops a moment later.

        Raises:
            NotFound: no such build.
            Conflict: the build has ended.
        """
        self._http.run(self._http.steps.builds.cancel_build(build_id))
