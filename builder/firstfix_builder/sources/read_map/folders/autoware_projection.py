"""Autoware's ``map_projector_info.yaml``: how a map's coordinates and degrees belong together.

map_projection_loader of autoware_core 1.0: ``LocalCartesian`` is the tangent frame at ``map_origin``, whose
altitude it does not use; ``LocalCartesianUTM``, ``TransverseMercator`` and ``MGRS`` are projections, whose
scale and north differ from place to place.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from firstfix.catalog.geopose import Georeference
from firstfix.errors import InvalidOption

from ..what_was_read import plain

TANGENT, HEIGHTS = "LocalCartesian", "WGS84"
_PUT = "PUT /maps/MAP/georeference"


@dataclass(frozen=True)
class Projection:
    """A projection.

    Attributes:
        words: its name, grid, origin and heights, as the file says.
        notes: the georeference that says the same, or why there is none, for people.
    """

    words: str
    notes: tuple[str, ...]


def projection_of(told: Mapping[str, Any]) -> Projection:
    """The projection of a file."""
    kind, datum = str(told.get("projector_type", "")), str(told.get("vertical_datum", ""))
    origin = told.get("map_origin")
    words = [kind, str(told.get("mgrs_grid", ""))]
    if isinstance(origin, Mapping):
        words.append(f"origin {origin.get('latitude')}, {origin.get('longitude')}")
    words.append(f"heights {datum}" if datum else "")
    note = _note(plain(kind), plain(datum), origin if isinstance(origin, Mapping) else {})
    return Projection(plain(" ".join(word for word in words if word)), (note,) if note else ())


def _note(kind: str, datum: str, origin: Mapping[str, Any]) -> str:
    if not kind or kind.lower() == "local":
        return ""
    if kind != TANGENT:
        return (
            f"georeference: none, since {kind} is a projection and no frame at one point. For poses in "
            f"degrees give latitude, longitude and heading of a point in the map's middle: {_PUT}"
        )
    if datum != HEIGHTS:
        return (
            f"georeference: none, since heights are {datum or 'of no datum'}, and a georeference has them "
            f"over the ellipsoid of {HEIGHTS}: {_PUT} with the height there"
        )
    try:
        at = Georeference.with_heading(float(origin["latitude"]), float(origin["longitude"]), 0.0, 0.0)
    except (KeyError, TypeError, ValueError, InvalidOption) as error:
        return f"georeference: none, since map_origin is not one: {plain(str(error))}"
    body = {
        "latitude_deg": at.latitude_deg,
        "longitude_deg": at.longitude_deg,
        "height_m": at.height_m,
        "x_axis_deg": at.x_axis_deg,
    }
    return f"georeference: for poses in degrees {_PUT} takes {json.dumps(body)}"
