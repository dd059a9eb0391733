"""The client's calls about maps and their versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .calls import Calls
from .records import MapInfo, VersionInfo
from .retrying_http import parsed


class MapCalls(Calls):
    """Maps, versions, and where maps lie. Part of ``Client``."""

    def maps(self) -> list[MapInfo]:
        """Every map that the service can localize in."""
        return list(self._pages("maps", MapInfo.from_mapping, "maps"))

    def show_map(self, map_id: str) -> MapInfo:
        """
        Raises:
            NotFound: no such map.
        """
        return parsed(self._call("GET", "maps", map_id), MapInfo.from_mapping)

    def versions(self, map_id: str) -> list[VersionInfo]:
        """Versions of a map, newest first.

        Raises:
            NotFound: no such map.
        """
        return list(self._pages("versions", VersionInfo.from_mapping, "maps", map_id, "versions"))

    def report(self, map_id: str, version: str) -> Mapping[str, Any]:
        """What a version's build measured of itself, as the service's JSON.

        Raises:
            NotFound: no such map or version.
        """
        return parsed(self._call("GET", "maps", map_id, "versions", version, "report"), dict)

    def activate(self, map_id: str, version: str) -> None:
        """Lets a published version answer from now on: back or forward.

        Raises:
            NotFound: no such map or version.
        """
        self._call("POST", "maps", map_id, "versions", version, "activate")

    def roll_back(self, map_id: str) -> str:
        """Lets the version answer that was active before the active one, and returns it.

        Raises:
            NotFound: no such map.
            Conflict: there is none.
        """
        # twice would come back: not repeated on a connection that broke half-way
        answer = self._call("POST", "maps", map_id, "rollback", repeatable=False)
        return parsed(answer, lambda data: str(data["active_version"]))

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Takes a version out of service.

        Args:
            force: also if it is the active one; the one that was active before answers then.

        Raises:
            NotFound: no such map or version.
            Conflict: it is the active one.
        """
        params = {"force": "true"} if force else {}
        self._call("DELETE", "maps", map_id, "versions", version, params=params, repeatable=False)

    def collect_garbage(self, map_id: str | None = None, *, dry_run: bool = False) -> Mapping[str, Any]:
        """Removes what nothing references, of one map or of the whole store; tells what, by kind."""
        path = ("collect-garbage",) if map_id is None else ("maps", map_id, "collect-garbage")
        return parsed(self._call("POST", *path, params={"dry_run": str(dry_run).lower()}), dict)

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
        body: dict[str, Any] = {
            "latitude_deg": latitude_deg,
            "longitude_deg": longitude_deg,
            "height_m": height_m,
            "anchor_m": [float(v) for v in anchor_m],
        }
        if x_axis_deg is not None:
            body["x_axis_deg"] = x_axis_deg
        if quaternion is not None:
            body["quaternion"] = [float(v) for v in quaternion]
        self._call("PUT", "maps", map_id, "georeference", json=body)

    def georeference(self, map_id: str) -> Mapping[str, Any]:
        """Where the map lies, as the service's JSON.

        Raises:
            NotFound: nobody said.
        """
        return parsed(self._call("GET", "maps", map_id, "georeference"), dict)

    def delete_georeference(self, map_id: str) -> None:
        """
        Raises:
            NotFound: there is none.
        """
        self._call("DELETE", "maps", map_id, "georeference", repeatable=False)
