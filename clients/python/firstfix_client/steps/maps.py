"""Requests about maps and their versions, and the reading of the answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from firstfix.errors import NotFound

from ..records import MapInfo, VersionInfo
from .http_sender import HttpSender
from .step import Steps

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters


class MapSteps:
    """Calls of ``MapCalls`` and ``AsyncMapCalls`` as steps."""

    def __init__(self, http: HttpSender) -> None:
        self._http = http

    def maps(self) -> Steps[None]:
        """Emit the maps."""
        return self._http.pages("maps", MapInfo.from_mapping, "maps")

    def show_map(self, map_id: str) -> Steps[MapInfo]:
        """Get one map."""
        answer = yield from self._http.call("GET", "maps", map_id)
        return answer.parsed(MapInfo.from_mapping)

    def descriptor_parameters(self, map_id: str) -> Steps[DescriptorParameters]:
        """Get the parameters with which scans for the active version are described."""
        from firstfix.scan.descriptor_parameters import DescriptorParameters

        manifest = (yield from self.show_map(map_id)).details.get("manifest")
        if not isinstance(manifest, Mapping):
            raise NotFound(f"map {map_id} has no active version")
        return DescriptorParameters.from_engine(manifest.get("engine", {}))

    def versions(self, map_id: str) -> Steps[None]:
        """Emit the versions of a map."""
        return self._http.pages("versions", VersionInfo.from_mapping, "maps", map_id, "versions")

    def report(self, map_id: str, version: str) -> Steps[Mapping[str, Any]]:
        """Get the self-test report of a version, as the service's JSON."""
        answer = yield from self._http.call("GET", "maps", map_id, "versions", version, "report")
        return answer.parsed(dict)

    def changes(self, map_id: str, version: str | None, cells: bool, grid: bool) -> Steps[Mapping[str, Any]]:
        """Get the areas that have changed since a map was made, as the service's JSON."""
        params = {"limit": "1000", "cells": str(cells).lower(), "grid": str(grid).lower()}
        if version is not None:
            params["version"] = version
        answer = yield from self._http.call("GET", "maps", map_id, "changes", params=params)
        return answer.parsed(dict)

    def activate(self, map_id: str, version: str) -> Steps[None]:
        """Make a published version the active one."""
        yield from self._http.call("POST", "maps", map_id, "versions", version, "activate")

    def roll_back(self, map_id: str) -> Steps[str]:
        """Make the previously active version active again, and return it."""
        # A second roll-back would undo the first: it is not repeated when a connection breaks.
        answer = yield from self._http.call("POST", "maps", map_id, "rollback", repeatable=False)
        return answer.parsed(lambda data: str(data["active_version"]))

    def patch(self, map_id: str, mode: str | None) -> Steps[str]:
        """Ask for a patch of the active version. Returns the build's id."""
        params = {} if mode is None else {"mode": mode}
        answer = yield from self._http.call("POST", "maps", map_id, "patch", params=params, repeatable=False)
        return answer.parsed(lambda data: str(data["build_id"]))

    def retire(self, map_id: str, version: str, force: bool) -> Steps[None]:
        """Take a version out of service."""
        params = {"force": "true"} if force else {}
        yield from self._http.call(
            "DELETE", "maps", map_id, "versions", version, params=params, repeatable=False
        )

    def collect_garbage(self, map_id: str | None, dry_run: bool) -> Steps[Mapping[str, Any]]:
        """Remove unreferenced objects. Returns counts by kind."""
        path = ("collect-garbage",) if map_id is None else ("maps", map_id, "collect-garbage")
        answer = yield from self._http.call("POST", *path, params={"dry_run": str(dry_run).lower()})
        return answer.parsed(dict)

    def set_georeference(
        self,
        map_id: str,
        latitude_deg: float,
        longitude_deg: float,
        height_m: float,
        x_axis_deg: float | None,
        quaternion: Sequence[float] | None,
        anchor_m: Sequence[float],
    ) -> Steps[None]:
        """Set the map's position and orientation on the Earth (WGS84)."""
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
        yield from self._http.call("PUT", "maps", map_id, "georeference", json=body)

    def georeference(self, map_id: str) -> Steps[Mapping[str, Any]]:
        """Get the map's georeference, as the service's JSON."""
        answer = yield from self._http.call("GET", "maps", map_id, "georeference")
        return answer.parsed(dict)

    def delete_georeference(self, map_id: str) -> Steps[None]:
        """Remove the map's georeference."""
        yield from self._http.call("DELETE", "maps", map_id, "georeference", repeatable=False)
