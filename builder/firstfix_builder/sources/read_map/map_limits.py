"""Limits of maps: of their decoders, and of the memory that a build may take."""

from __future__ import annotations

import resource
from dataclasses import dataclass

from firstfix.builds.limits import memory_bytes
from firstfix.errors import UnfitMap
from firstfix.findings.map_kinds import MAP_MEMORY
from firstfix.formats.point_cloud import MAP_LIMITS, Limits

# Measured with clouds of 0.5 to 2.7 million points: the file's records, float64, and copies while they are
# cleaned. Later stages work in tiles.
BASE_BYTES, BYTES_A_POINT = 250_000_000, 180


@dataclass(frozen=True)
class MapLimits(Limits):
    """Limits that also compare what a cloud needs with the memory there is, before any of it is taken."""

    def check(self, format_name: str, points: int, record_bytes: int) -> None:
        """Check the size that a header declares.

        Raises:
            TooLarge: more points or bytes than allowed.
            UnfitMap: it needs more memory than this process may take.
        """
        super().check(format_name, points, record_bytes)
        needed, there = BASE_BYTES + BYTES_A_POINT * points, _there_bytes()
        if needed > there:
            found = MAP_MEMORY.found({"points": points, "needed_gb": needed / 1e9, "there_gb": there / 1e9})
            raise UnfitMap(f"{found.text} {found.remedy}")


def _there_bytes() -> int:
    """Memory that this process may take: of the machine, its container and its own limit."""
    soft, _ = resource.getrlimit(resource.RLIMIT_DATA)
    return memory_bytes() if soft == resource.RLIM_INFINITY else min(soft, memory_bytes())


LIMITS = MapLimits(MAP_LIMITS.max_points, MAP_LIMITS.max_decoded_bytes)
