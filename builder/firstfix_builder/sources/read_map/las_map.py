"""LAS, LAZ and COPC as maps: with the unit that the file tells, without withheld points and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import UnsupportedFormat
from firstfix.formats.las import read_las
from firstfix.formats.las_units import LasUnits, las_units
from firstfix.formats.laz_chunks import check_las

from .map_data import MapData, finite_cloud
from .map_limits import LIMITS
from .what_was_read import LeftOut, WhatWasRead, plain

_PROJECT = (
    "project them to metres, as for UTM 32 with pdal translate IN.laz OUT.laz reprojection "
    "--filters.reprojection.out_srs=EPSG:32632"
)
MAX_DEGREES = 1.0  # across a map in degrees: some 100 km


def read_las_map(path: Path) -> MapData:
    """A file to a map in its own frame and unit.

    Raises:
        MalformedData: the file is damaged, cut off, or has no point that counts.
        TooLarge: over the limits.
        UnsupportedFormat: its coordinates are degrees.
    """
    header = check_las(path, LIMITS, 8 * 4)
    units = las_units(path, header)
    cloud = read_las(path, LIMITS)
    points, intensity = finite_cloud(cloud)
    if units.across is not None and units.across.metres is None and _are_degrees(points):
        system = plain(units.system) or "as it says"
        raise UnsupportedFormat(f"its coordinates are degrees ({system}): {_PROJECT}")
    across_m, up_m = _metres(units)
    read = WhatWasRead(
        form=f"{'LAZ' if header.packing else 'LAS'} {header.version}",
        program=plain(header.program),
        unit=plain(_named(units)),
        georeference=plain(units.system),
    ).without(
        LeftOut("points", "withheld, which stands for deleted", cloud.withheld),
        LeftOut("points", "classed as noise (7 or 18)", cloud.noise),
    )
    return MapData(points=points, intensity=intensity, metres=(across_m, up_m), read=read)


def _metres(units: LasUnits) -> tuple[float, float]:
    """Metres in one unit of x and y, and of z. A height without a unit is in that of x and y."""
    across_m = 1.0 if units.across is None or units.across.metres is None else units.across.metres
    return across_m, across_m if units.up is None or units.up.metres is None else units.up.metres


def _named(units: LasUnits) -> str:
    if units.across is None:
        return ""
    if units.up is None or units.up == units.across:
        return units.across.name
    return f"{units.across.name}, heights in {units.up.name}"


def _are_degrees(points: NDArray[np.float64]) -> bool:
    """Whether (n, 3) points can be degrees: files with metres say so as well."""
    return bool((np.abs(points[:, :2]) <= 360).all() and np.ptp(points[:, :2], axis=0).max() < MAX_DEGREES)
