"""Whether a map is in metres, by its extent, its height and the spacing of its points."""

from __future__ import annotations

import math

from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_GARBLED, MAP_TOO_COARSE, MAP_UNIT

from .shape import Shape

MIN_EXTENT_M = 2.0  # no robot needs a cloud of less; a mesh may be a part of a map
MAX_SPACING_M = 2.0  # points further apart show no surface
MAX_HEIGHT_M = 1_000.0
NO_UNIT_M = 1e7  # no place is as large in any unit: the numbers are none of coordinates
# A spacing of decimetres is usual outdoors, and a height of hundreds of metres in the mountains. Both are a
# hall in centimetres.
WIDE_SPACING_M, TALL_M = 0.6, 200.0
# What maps of robots are like, and by which factor they commonly differ from it.
_USUAL = {"spacing_m": (0.08, 3.0), "extent_m": (80.0, 4.0), "height_m": (8.0, 3.0)}
_UNITS = {
    0.001: "the millimetre",
    0.01: "the centimetre",
    100.0: "100 m",
    1000.0: "the kilometre",
}


def check_unit(shape: Shape) -> Finding | None:
    """Finding of a map that cannot be in metres, with the scale that fits best."""
    extent_m, height_m, spacing_m = float(shape.extent_m.max()), float(shape.extent_m[2]), shape.spacing_m
    if extent_m > NO_UNIT_M:
        return MAP_GARBLED.found(shape.numbers, **shape.words)
    too_coarse = spacing_m is not None and spacing_m > MAX_SPACING_M
    too_tall = height_m > MAX_HEIGHT_M
    too_tall |= spacing_m is not None and spacing_m > WIDE_SPACING_M and height_m > TALL_M
    too_small = spacing_m is not None and extent_m < MIN_EXTENT_M
    if not (too_coarse or too_tall or too_small):
        return None
    scale = min(_UNITS, key=lambda one: _oddness(shape, one))
    if _oddness(shape, scale) < _oddness(shape, 1.0) and (too_coarse or too_tall) == (scale < 1):
        return MAP_UNIT.found({**shape.numbers, "scale": scale}, unit=_UNITS[scale], **shape.words)
    return MAP_TOO_COARSE.found(shape.numbers, **shape.words) if too_coarse else None


def _oddness(shape: Shape, scale: float) -> float:
    """How far a map of this scale is from what maps of robots are like."""
    found = {"extent_m": float(shape.extent_m[:2].max()), "height_m": float(shape.extent_m[2])}
    if shape.spacing_m is not None:
        found["spacing_m"] = shape.spacing_m
    odd = 0.0
    for name, value in found.items():
        usual, factor = _USUAL[name]
        odd += (math.log(max(value * scale, 1e-9) / usual) / math.log(factor)) ** 2
    return odd
