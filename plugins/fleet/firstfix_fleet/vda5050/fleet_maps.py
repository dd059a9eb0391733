"""The maps of a fleet: firstfix's ids and versions, and VDA 5050's ``mapId`` and ``mapVersion``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from .messages import VehicleMap
from .planar_fix import NoFix, PlanarFix

MAX_STORED = 100  # maps of the fleet that are kept in mind of one vehicle


@dataclass(frozen=True)
class FleetMap:
    """One map as vehicles name it.

    Attributes:
        map_id: VDA 5050's.
        versions: mapVersion by the first characters of firstfix's version. Empty: whichever is enabled.
        T_vda_map: x, y (m) and heading (rad) of firstfix's map frame in the vehicles' map.
    """

    map_id: str
    versions: Mapping[str, str] = field(default_factory=dict)
    T_vda_map: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def place(self, fix: PlanarFix) -> PlanarFix:
        """A fix in the coordinates of the vehicles' map."""
        x_m, y_m, theta_rad = self.T_vda_map
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        return replace(
            fix,
            x_m=x_m + c * fix.x_m - s * fix.y_m,
            y_m=y_m + s * fix.x_m + c * fix.y_m,
            theta_rad=math.remainder(theta_rad + fix.theta_rad, 2 * math.pi),
        )


@dataclass(frozen=True)
class MapOnVehicle:
    """The map in which a pose is sent.

    Attributes:
        map_id: VDA 5050's.
        enable: mapVersion that the vehicle has to enable first; None: none.
        fix: in the coordinates of this map.
    """

    map_id: str
    enable: str | None
    fix: PlanarFix


class FleetMaps:
    """The maps that a fleet's vehicles are searched in, by firstfix's ids."""

    def __init__(self, maps: Mapping[str, FleetMap]) -> None:
        self._maps = maps
        self._map_ids = frozenset(one.map_id for one in maps.values())

    def known(self, stored: Iterable[VehicleMap] | None) -> tuple[VehicleMap, ...] | None:
        """Stored maps of a vehicle that are the fleet's; None if it does not say."""
        if stored is None:
            return None
        return tuple(itertools.islice((one for one in stored if one.map_id in self._map_ids), MAX_STORED))

    def choose(self, fix: PlanarFix, stored: tuple[VehicleMap, ...] | None) -> MapOnVehicle | NoFix:
        """The map in which a fix is sent to a vehicle.

        Args:
            stored: the maps on the vehicle; None: version 2.0 has no field for them.
        """
        map_id, map_version = fix.map_id, fix.map_version
        ours = self._maps.get(map_id)
        if ours is None:
            return NoFix(f"the fleet has no map {map_id!r}")
        wanted = next((theirs for ffx, theirs in ours.versions.items() if map_version.startswith(ffx)), None)
        if ours.versions and wanted is None:
            return NoFix(f"version {map_version[:12]} of map {map_id} has no mapVersion in the fleets' file")
        if stored is None:
            return MapOnVehicle(ours.map_id, None, ours.place(fix))
        here = [one for one in stored if one.map_id == ours.map_id]
        enabled = next((one.map_version for one in here if one.is_enabled), None)
        if wanted is None:
            wanted = enabled if enabled is not None else here[0].map_version if len(here) == 1 else None
        if wanted is None and here:
            return NoFix(f"it has {len(here)} versions of map {ours.map_id!r}, and none is enabled")
        if wanted not in {one.map_version for one in here}:
            return NoFix(
                f"it has no map {ours.map_id!r}" + ("" if wanted is None else f" of version {wanted!r}")
            )
        return MapOnVehicle(ours.map_id, None if wanted == enabled else wanted, ours.place(fix))
