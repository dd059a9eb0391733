"""The maps of a fleet: firstfix's ids and versions, and VDA 5050's ``mapId`` and ``mapVersion``."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from .messages import VehicleMap
from .planar_fix import NoFix

MOST_STORED = 100  # maps of the fleet that are kept in mind of one vehicle


@dataclass(frozen=True)
class FleetMap:
    """One map as vehicles name it.

    Attributes:
        map_id: VDA 5050's.
        versions: mapVersion by the first characters of firstfix's version. Empty: whichever is enabled.
    """

    map_id: str
    versions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class MapOnVehicle:
    """The map in which a pose is sent.

    Attributes:
        map_id: VDA 5050's.
        enable: mapVersion that the vehicle has to enable first; None: none.
    """

    map_id: str
    enable: str | None


class FleetMaps:
    """The maps that a fleet's vehicles are searched in, by firstfix's ids."""

    def __init__(self, maps: Mapping[str, FleetMap]) -> None:
        self._maps = maps
        self._map_ids = frozenset(one.map_id for one in maps.values())

    def known(self, stored: Iterable[VehicleMap] | None) -> tuple[VehicleMap, ...] | None:
        """Returns those of a vehicle's stored maps that are the fleet's; None if it does not say."""
        if stored is None:
            return None
        return tuple(itertools.islice((one for one in stored if one.map_id in self._map_ids), MOST_STORED))

    def choose(
        self, map_id: str, map_version: str, stored: tuple[VehicleMap, ...] | None
    ) -> MapOnVehicle | NoFix:
        """Returns the map in which a fix is sent to a vehicle.

        Args:
            map_id, map_version: firstfix's, of the fix.
            stored: the maps on the vehicle; None: version 2.0 has no field for them.
        """
        ours = self._maps.get(map_id)
        if ours is None:
            return NoFix(f"the fleet has no map {map_id!r}")
        wanted = next((theirs for ffx, theirs in ours.versions.items() if map_version.startswith(ffx)), None)
        if ours.versions and wanted is None:
            return NoFix(f"version {map_version[:12]} of map {map_id} has no mapVersion in the fleets' file")
        if stored is None:
            return MapOnVehicle(ours.map_id, None)
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
        return MapOnVehicle(ours.map_id, None if wanted == enabled else wanted)
