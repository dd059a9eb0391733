"""Facts of a scan as it came, which are in every answer: they tell a wrong input from a wrong place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any


@dataclass(frozen=True)
class ScanFacts:
    """Facts of a scan; of a query with several scans, the last one.

    Attributes:
        points: points that came, with those that are no returns.
        valid: of these, the finite ones within 1,000 m.
        in_range: of these, those within the map's least and largest range, which are used.
        median_range_m: of the finite points; None: there is none. Measured on a part of them.
        largest_range_m: of the valid points; None: there is none. Measured on a part of them.
        rings: elevations at which the points lie, as the beams of a spinning LiDAR; None: in no rings.
        plane_ratio: 0..1, thickness of the points over their breadth: 0 in one plane. None: too few points.
        time_span_s: from the first to the last point; None: their times are not known.
    """

    points: int
    valid: int
    in_range: int
    median_range_m: float | None = None
    largest_range_m: float | None = None
    rings: int | None = None
    plane_ratio: float | None = None
    time_span_s: float | None = None

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        return asdict(self)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> ScanFacts:
        """Read what ``to_mapping`` returned. Unknown keys are ignored."""
        return cls(**{field.name: data.get(field.name) for field in fields(cls)})  # type: ignore[arg-type]
