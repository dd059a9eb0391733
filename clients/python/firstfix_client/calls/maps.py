"""Blocking calls about maps and their versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..records import MapInfo, VersionInfo
from .base import HttpCalls

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


class MapCalls(HttpCalls):
    """Calls about maps, versions and georeferences. Part of ``Client``; of ``ZenohClient`` with a URL."""

    def maps(self) -> list[MapInfo]:
        """Returns the maps that the service can localize in."""
        return list(self._http.items(self._http.steps.maps.maps()))

    def show_map(self, map_id: str) -> MapInfo:
        """Returns one map.

        Raises:
            NotFound: no such map.
        """
        return self._http.run(self._http.steps.maps.show_map(map_id))

    def descriptor_parameters(self, map_id: str) -> DescriptorParameters:
        """Returns the parameters with which a robot describes scans for the map's active version.

        Raises:
            NotFound: no such map, or no version of it is active.
            UnsupportedFormat: this client cannot compute the version's descriptor.
        """
        return self._http.run(self._http.steps.maps.descriptor_parameters(map_id))

    def versions(self, map_id: str) -> list[VersionInfo]:
        """Returns the versions of a map, newest first.

        Raises:
            NotFound: no such map.
        """
        return list(self._http.items(self._http.steps.maps.versions(map_id)))

    def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """Returns the self-test report of a version, as the service's JSON.

        Raises:
            NotFound: no such map or version.
        """
        return self._http.run(self._http.steps.maps.report(map_id, version))

    def changes(
        self, map_id: str, version: str | None = None, *, cells: bool = False, grid: bool = False
    ) -> Mapping[str, Any]:
        """Returns the areas that have changed since the map was made, as the service's JSON.

        Args:
            version: default: the active version.
            cells: list the cells of each area.
            grid: list the counts of all cells.

        Raises:
            NotFound: no such map or version.
        """
        return self._http.run(self._http.steps.maps.changes(map_id, version, cells, grid))

    def activate(self, map_id: str, version: str) -> None:
        """Makes a published version the active one, which answers queries.

        Raises:
            NotFound: no such map or version.
        """
        self._http.run(self._http.steps.maps.activate(map_id, version))

    def roll_back(self, map_id: str) -> str:
        """Makes the previously active version active again, and returns it.

        Raises:
            NotFound: no such map.
            Conflict: no version was active before.
        """
        return self._http.run(self._http.steps.maps.roll_back(map_id))

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Takes a version out of service.

        Args:
            force: also if it is the active version; the previously active one then answers.

        Raises:
            NotFound: no such map or version.
            Conflict: it is the active version, and ``force`` is not set.
        """
        self._http.run(self._http.steps.maps.retire(map_id, version, force))

    def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Removes unreferenced objects of one map, or of the whole store. Returns counts by kind."""
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
        """Sets the map's position and orientation on the Earth (WGS84).

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
        """Returns the map's georeference, as the service's JSON.

        Raises:
            NotFound: no such map, or it has no georeference.
        """
        return self._http.run(self._http.steps.maps.georeference(map_id))

    def delete_georeference(self, map_id: str) -> None:
        """Removes the map's georeference.

        Raises:
            NotFound: no such map, or it has no georeference.
        """
        self._http.run(self._http.steps.maps.delete_georeference(map_id))
