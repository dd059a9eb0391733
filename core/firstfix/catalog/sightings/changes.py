"""Changes of a map version and its unmapped parts, as the service and the command line show them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.changes.areas import KINDS as COLUMNS
from ...engine.changes.areas import Area, find_areas
from ...engine.changes.cells import CELL_M, cells_of_keys, keys_of
from ...engine.changes.tally import KINDS, Tally
from .record import SightingsRecord

MAX_GRID_CELLS = 50_000
MAX_AREA_CELLS = 10_000  # that are listed; an area may have more


def changes_of(
    record: SightingsRecord, *, limit: int = 100, with_cells: bool = False, with_grid: bool = False
) -> dict[str, Any]:
    """Areas that have changed or were never mapped, ready for JSON.

    Args:
        limit: of the areas, which come in the order of ``find_areas``.
        with_cells: list the cells of each area.
        with_grid: list the counts of all cells.
    """
    days, tally = record.days.values(), record.newest_first()
    areas = find_areas(tally)
    found: dict[str, Any] = {
        "cell_m": CELL_M,
        "sightings": sum(day.tally.sightings for day in days),
        "coverage_known": sum(day.tally.coverage_known for day in days),
        "seen_cells": len(np.unique(tally.cell)),
        "first_time": min((day.first_time for day in days), default=None),
        "last_time": max((day.last_time for day in days), default=None),
        "areas_found": len(areas),
        "areas": [{**_to_mapping(area, with_cells), **_times(area, record)} for area in areas[:limit]],
    }
    if with_grid:
        found["grid"] = _grid(tally)
    return found


def _to_mapping(area: Area, with_cells: bool) -> dict[str, Any]:
    low, high = area.box_m
    best = int(np.argmax(area.sightings[:, 0]))
    values: dict[str, Any] = {
        "kind": area.kind,
        "box": {"low": low.tolist(), "high": high.tolist()},
        "cells": len(area.cells),
        "share": round(float(area.share.mean()), 3),
        "spots": int(area.spots.max()),
        "sightings": int(area.sightings[best, 0]),
        "against": int(area.sightings[best, 1]),
    }
    if with_cells:
        values["cell_list"] = area.cells[:MAX_AREA_CELLS].tolist()
    return values


def _times(area: Area, record: SightingsRecord) -> dict[str, str]:
    """Times of the first and the last part of the days on which the area was seen so."""
    keys, column = keys_of(area.cells), COLUMNS[area.kind][0]
    seen = [
        day
        for day in record.days.values()
        if (np.isin(day.tally.cell, keys) & (day.tally.counts[:, column] > 0)).any()
    ]
    return {
        "first_seen": min(day.first_time for day in seen),
        "last_seen": max(day.last_time for day in seen),
    }


def _grid(tally: Tally) -> dict[str, Any]:
    """Count by cell, those with most sightings against the map first."""
    cell, row = np.unique(tally.cell, return_inverse=True)
    counts: NDArray[np.int64] = np.stack(
        [np.bincount(row, tally.counts[:, k], len(cell)) for k in range(len(KINDS))], axis=1
    ).astype(np.int64)
    order = np.argsort(-(counts[:, 1] + counts[:, 2]), kind="stable")[:MAX_GRID_CELLS]
    columns = {kind: counts[order, k].tolist() for k, kind in enumerate(KINDS)}
    return {"cells_found": len(cell), "cells": cells_of_keys(cell[order]).tolist(), **columns}
