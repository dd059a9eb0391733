"""Cities of any size: more ground, and more templates on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...worlds.city.city import City
from ...worlds.city.write_city import write_meshes

SEED = 7


@dataclass(frozen=True)
class Extent:
    """Size of a world.

    Attributes:
        extent_m: of the city along x and y.
        spacing_m: of its templates; None: what the build finds.
        config: of the build, beside the sensor.
    """

    name: str
    extent_m: float
    spacing_m: float | None = None
    config: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write the meshes, block by block: the same bytes every time."""
        write_meshes(City.of_extent(self.extent_m, SEED), folder / "mesh")


SPACING_M = 0.42
EXTENTS = {
    "30k": Extent("30k", 80.0, SPACING_M),
    "100k": Extent("100k", 160.0, SPACING_M),
    "1M": Extent("1M", 480.0, SPACING_M),
    "10M": Extent("10M", 1520.0, SPACING_M),
}
BY_DEFAULT = ("30k", "100k", "1M")
_QUICKLY = {"self_test": {"queries": 12, "outside": 4}, "learn_keys": {"scans": 60}}
QUICK = {
    "small": Extent("small", 80.0, 2.4, _QUICKLY),
    "larger": Extent("larger", 80.0, 1.5, _QUICKLY),
}
