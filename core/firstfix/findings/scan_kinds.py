"""Kinds of findings of scans: what each code says, and what helps."""

from __future__ import annotations

from .finding import Severity
from .kind import FindingKind

PAGE = "docs/how-to/my-scan-is-not-localized.md"


def _kind(code: str, severity: Severity, symptom: str, text: str, remedy: str) -> FindingKind:
    return FindingKind(code, severity, symptom, text, remedy, PAGE)


SCAN_EMPTY = _kind(
    "scan_empty",
    Severity.ERROR,
    "The scan has no points",
    "The scan has no points.",
    "Look at the driver: the LiDAR sends nothing, or the file was written before the first scan came.",
)
NOTHING_VALID = _kind(
    "nothing_valid",
    Severity.ERROR,
    "All points are NaN, infinite or (0, 0, 0)",
    "None of {points:,.0f} points is a return: {not_finite:,.0f} are NaN or infinite, {zero:,.0f} are "
    "(0, 0, 0).",
    "Look at the driver: it writes these for beams without a return. Is the sensor covered or starting?",
)
IN_MILLIMETRES = _kind(
    "unit_millimetres",
    Severity.ERROR,
    "The ranges are a thousand times too long",
    "Of {points:,.0f} points, {in_range:,.0f} lie within 1,000 m, and the median range is "
    "{median_range_m:,.0f} m. Are they in millimetres?",
    "Send metres: divide the coordinates by 1000.",
)
IN_CENTIMETRES = _kind(
    "unit_centimetres",
    Severity.ERROR,
    "The ranges are a hundred times too long",
    "Of {points:,.0f} points, {in_range:,.0f} lie within 1,000 m, and the median range is "
    "{median_range_m:,.0f} m. Are they in centimetres?",
    "Send metres: divide the coordinates by 100.",
)
IN_MAP_COORDINATES = _kind(
    "map_coordinates",
    Severity.ERROR,
    "The coordinates are those of a map projection, as UTM",
    "The points lie {median_range_m:,.0f} m from the sensor and within {spread_m:,.0f} m of each other: "
    "they have the coordinates of a map, as UTM.",
    "Send the scan in the sensor's frame, where the sensor is at (0, 0, 0).",
)
ALL_TOO_NEAR = _kind(
    "all_too_near",
    Severity.ERROR,
    "All points are nearer than the least range",
    "Of {points:,.0f} points, {too_near:,.0f} are nearer than {min_range_m:g} m, the farthest at "
    "{largest_range_m:.2f} m: a wrong unit, or only the robot itself.",
    "Send metres. If the unit is right, the sensor sees the robot or a cover only.",
)
TRANSPOSED = _kind(
    "transposed",
    Severity.ERROR,
    "The array has three rows instead of three columns",
    "The array has the shape ({rows:.0f}, {columns:,.0f}); scans are (n, 3): one row for each point.",
    "Transpose the array.",
)
ONE_PLANE = _kind(
    "one_plane",
    Severity.ERROR,
    "The points are those of one ring or of a 2-D LiDAR",
    "All {valid:,.0f} points lie in one plane: one ring, or a 2-D LiDAR's scan. firstfix needs a 3-D LiDAR.",
    "Send all rings of the LiDAR. 2-D LiDARs are not supported.",
)
FEW_POINTS = _kind(
    "few_points",
    Severity.ERROR,
    "The scan has too few points",
    "The scan has {in_range:,.0f} points within {min_range_m:g} to {max_range_m:g} m, in {cells:,.0f} cells "
    "of {voxel_m:g} m: at least {needed:,.0f} are needed.",
    "Send the whole scan, unfiltered: thinning is done by firstfix. Is the sensor covered?",
)
