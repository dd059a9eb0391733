"""The client's calls about maps and their versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .http_calls import HttpCalls
from .records import MapInfo, VersionInfo

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


class MapCalls(HttpCalls):
    """Maps, versions, and where maps lie. Part of ``Client`` and, with a URL, of ``ZenohClient``."""

    def maps(self) -> list[MapInfo]:
        """Every map that the service can localize in."""
        return list(self._http.items(self._http.steps.maps.maps()))

    def show_map(self, map_id: str) -> MapInfo:
        """
        Raises:
            NotFound: no such map.
        """
        return self._http.run(self._http.steps.maps.show_map(map_id))

    def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        """How scans for the map's active version are described.

        Raises:
            NotFound: no such map, or no version of it is active.
            UnsupportedFormat: robots cannot describe scans for it.
        """
        return self._http.run(self._http.steps.maps.descriptor_parameters(map_id))

    def versions(self, map_id: str) -> list[VersionInfo]:
        """Versions of a map, newest first.

        Raises:
            NotFound: no such map.
        """
        return list(self._http.items(self._http.steps.maps.versions(map_id)))

    def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """What a version's build measured of itself, as the service's JSON.

        Raises:
            NotFound: no such map or version.
        """
        return self._http.run(self._http.steps.maps.report(map_id, version))

    def activate(self, map_id: str, version: str) -> None:
        """Lets a published version answer from now on: back or forward.

        Raises:
            NotFound: no such map or version.
        """
        self._http.run(self._http.steps.maps.activate(map_id, version))

    def roll_back(self, map_id: str) -> str:
        """Lets the version answer that was active before the active one, and returns it.

        Raises:
            NotFound: no such map.
            Conflict: there is none.
        """
        return self._http.run(self._http.steps.maps.roll_back(map_id))

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Takes a version out of service.

        Args:
            force: also if it is the active one; the one that was active before answers then.

        Raises:
            NotFound: no such map or version.
            Conflict: it is the active one.
        """
        self._http.run(self._http.steps.maps.retire(map_id, version, force))

    def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Removes what nothing references, of one map or of the whole store; tells what, by kind."""
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
        """Says where a point of the map lies on the Earth (WGS84) and how the map is turned there.

        Args:
            height_m: above the ellipsoid.
            x_axis_deg: where the map's x axis points, counter-clockwise from east; or
            quaternion: (x, y, z, w) that turns map axes into east, north, up.
            anchor_m: (3,) the point, in map coordinates.

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
        """Where the map lies, as the service's JSON.

        Raises:
            NotFound: nobody said.
        """
        return self._http.run(self._http.steps.maps.georeference(map_id))

    def delete_georeference(self, map_id: str) -> None:
        """
        Raises:
            NotFound: there is none.
        """
        self._http.run(self._http.steps.maps.delete_georeference(map_id))
