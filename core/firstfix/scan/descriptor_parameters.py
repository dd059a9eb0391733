"""Parameters with which a robot condenses and describes its scans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from ..descriptor import LayeredOccupancy, PolarGrid
from ..errors import InvalidOption, UnsupportedFormat

_MAX_M = 1e4


@dataclass(frozen=True)
class DescriptorParameters:
    """Parameters of a map's descriptors.

    The defaults are right for every map if there is no descriptor. A descriptor's parameters belong to one
    version of a map.

    Attributes:
        min_range_m, max_range_m: returns outside are left out.
        voxel_m: voxel size of the points that are sent.
        default_height_m: height of the sensor above the floor, if the scan shows no floor.
        descriptor: the map's descriptor. None: the server describes the scan.
    """

    min_range_m: float = 0.5
    max_range_m: float = 60.0
    voxel_m: float = 0.3
    default_height_m: float = 1.0
    descriptor: LayeredOccupancy | None = None

    @classmethod
    def from_engine(cls, engine: Mapping[str, Any]) -> DescriptorParameters:
        """Read the parameters from ``engine`` of a version's manifest (``GET /maps/{id}``).

        Raises:
            UnsupportedFormat: the map has another kind of descriptor, or this is not an engine's config.
        """
        try:
            described, used = engine["descriptor"], engine["preprocess"]
            if described["kind"] != "occupancy":
                raise UnsupportedFormat(f"robots cannot compute this map's descriptor {described['kind']!r}")
            grid = PolarGrid(
                int(described["rings"]), int(described["sectors"]), float(described["max_range_m"])
            )
            edges_m = tuple(float(edge) for edge in described["layer_edges_m"])
            return cls(
                float(used["min_range_m"]),
                float(used["max_range_m"]),
                float(used["voxel_m"]),
                float(used["default_height_m"]),
                LayeredOccupancy(grid, edges_m),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise UnsupportedFormat(f"malformed engine of a map: {error!r}") from None

    def check(self) -> None:
        """Refuse values that no map has, before anything is computed with them.

        Raises:
            InvalidOption: a value is out of range.
        """
        usable = (
            0 <= self.min_range_m <= _MAX_M
            and 0 < self.max_range_m <= _MAX_M
            and 0.01 <= self.voxel_m <= 10
            and abs(self.default_height_m) <= 100
            and (self.descriptor is None or _is_usable(self.descriptor))
        )
        if not usable:
            raise InvalidOption("a descriptor parameter is out of range")


def _is_usable(descriptor: LayeredOccupancy) -> bool:
    grid, edges_m = descriptor.grid, descriptor.edges_m
    return (
        1 <= grid.rings <= 200
        and 1 <= grid.sectors <= 720
        and 0.01 <= grid.max_range_m <= 1000
        and 2 <= len(edges_m) <= 17
        and all(abs(edge) <= 1e6 for edge in edges_m)
        and all(low < high for low, high in pairwise(edges_m))
    )
