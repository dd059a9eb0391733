"""What a robot needs to know of a map to describe its scans as the map's templates are described."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..descriptor import LayeredOccupancy, PolarGrid
from ..errors import UnsupportedFormat


@dataclass(frozen=True)
class QueryParameters:
    """The defaults suit every map; a descriptor belongs to one map's version.

    Attributes:
        min_range_m, max_range_m: returns outside are left out.
        voxel_m: of the points that are sent.
        default_height_m: of the sensor, where no floor is seen.
        descriptor: None: the server describes.
    """

    min_range_m: float = 0.5
    max_range_m: float = 60.0
    voxel_m: float = 0.3
    default_height_m: float = 1.0
    descriptor: LayeredOccupancy | None = None

    @classmethod
    def from_engine(cls, engine: Mapping[str, Any]) -> QueryParameters:
        """From ``engine`` in a version's manifest, as ``GET /maps/{id}`` shows it.

        Raises:
            UnsupportedFormat: that map is described in another way, or this is no engine's config.
        """
        try:
            described, used = engine["descriptor"], engine["preprocess"]
            if described["kind"] != "occupancy":
                raise UnsupportedFormat(f"robots cannot compute a map's {described['kind']!r} descriptor")
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
            raise UnsupportedFormat(f"this is no map's engine: {error!r}") from None
