"""Chooses the spacing of the templates by the view distance, unless the config sets it.

In a room the view changes with every step, so templates stand close together. In the open one template can
represent a whole block, because alignment corrects an offset of more than a metre.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk
from ..execution.stage_cache import StageResult
from ..mesh.map_tiles import by_nested_tiles
from ..stage_results import CHUNK_START_FILE, POSITIONS_FILE, SPACING_FILE, VIEW_FILE
from ..viewpoints.even_sample import rows_by_hash
from ..viewpoints.floor_chunks import tiled_viewpoints
from ..viewpoints.left_out_floor import FLOOR_FILE, LEFT_OUT_FILE
from ..viewpoints.sample import DEFAULT_SPACING_M
from ..viewpoints.tiles import Tiling, in_order
from .make import chunk_tile_m
from .view_distance import (
    OPEN_SPACING_M,
    VIEWPOINT_CELL_M,
    VIEWPOINTS,
    InformativeViewpoints,
    LookChunk,
    percentile_m,
)

ROOM_SPACING_M = 0.5
ROOM_VIEW_M = 12.0  # below this view distance, 0.5 m finds twice as many places as 1 m

Run = Callable[[Sequence[Chunk]], Iterator[Arrays]]
RunAt = Callable[[StageResult, Sequence[Chunk]], Iterator[Arrays]]


def write_places(
    run: Run,
    read: Path,
    mesh: Path,
    config: ViewpointConfig,
    spacing_m: float,
    sensor: SensorModel,
    out: Path,
) -> None:
    """Write the viewpoints of one spacing, tile by tile.

    ``positions.npy`` and ``floor_z.npy`` as in ``Viewpoints``; ``tile.npy`` and ``tile_start.npy``: which
    tiles have some, and where they start; ``shown.npy``: the rows of those that tell how far one sees;
    ``left_out.npy`` where the map has a trajectory: as in ``Viewpoints``.

    Args:
        run: runs chunks that read the inputs ``map`` and ``mesh``.

    Raises:
        BuildFailed: there is no floor to stand on.
    """
    _, parts = tiled_viewpoints(run, read, mesh, config, spacing_m, sensor.mount_height_m)
    tiles, start = [], [0]
    positions, floor_z, left_out = [], [], []
    shown = np.zeros((0, 4))
    for tile, found in parts:
        if found.left_out is not None:
            left_out.append(found.left_out)
        if not len(found):
            continue
        tiles.append(tile)
        positions.append(found.positions)
        floor_z.append(found.floor_z)
        shown = _shown(np.concatenate([shown, _numbered(found.positions, start[-1])]))
        start.append(start[-1] + len(found))
    np.save(out / "positions.npy", np.concatenate(positions))
    np.save(out / "floor_z.npy", np.concatenate(floor_z))
    np.save(out / "tile.npy", np.array(tiles, np.int64))
    np.save(out / "tile_start.npy", np.array(start, np.int64))
    np.save(out / "shown.npy", shown[:, 3].astype(np.int64))
    if left_out:
        np.save(out / LEFT_OUT_FILE, np.concatenate(left_out))


def fitting_viewpoints(
    places_at: Callable[[float], StageResult],
    run: RunAt,
    config: ViewpointConfig,
    sensor: SensorModel,
    out: Path,
) -> None:
    """Write the viewpoints of a map in the order in which templates are made.

    ``positions.npy``, ``floor_z.npy``; ``chunk_start.npy``: where the tiles of chunks start;
    ``spacing_m.npy``: the largest spacing between them; ``view_m.npy``: how far one sees from them, the
    ground included. Where the map has a trajectory, ``left_out.npy`` of ``write_places``, and ``floor.json``:
    how much floor that is.

    Args:
        places_at: makes the places of ``write_places`` at a spacing.
        run: runs chunks that read the input ``mesh``, and such places as the input ``places``.
    """
    spacing_m = config.spacing_m or DEFAULT_SPACING_M
    places = places_at(spacing_m)
    keep: NDArray[np.bool_] | None = None
    if config.spacing_m is None:
        rows = np.load(places.directory / "shown.npy")
        if percentile_m(_looks(run, places, spacing_m, rows, sensor, "off_ground_m"), sensor) < ROOM_VIEW_M:
            spacing_m = ROOM_SPACING_M
            places = places_at(spacing_m)
        else:
            keep = _informative_mask(run, places, spacing_m, sensor)
    places_m = spacing_m
    positions, floor_z = (np.load(places.directory / f"{name}.npy") for name in ("positions", "floor_z"))
    rows = np.arange(len(positions)) if keep is None else np.flatnonzero(keep)
    shown = rows[rows_by_hash(positions[rows], VIEWPOINTS, VIEWPOINT_CELL_M)]
    view_m = percentile_m(_looks(run, places, spacing_m, shown, sensor, "furthest_m"), sensor)
    if keep is not None and not keep.all():
        spacing_m = OPEN_SPACING_M
    order, start = by_nested_tiles(positions[rows], config.tile_m, chunk_tile_m(config.tile_m, spacing_m))
    np.save(out / POSITIONS_FILE, positions[rows[order]])
    np.save(out / "floor_z.npy", floor_z[rows[order]])
    np.save(out / CHUNK_START_FILE, start)
    np.save(out / SPACING_FILE, spacing_m)
    np.save(out / VIEW_FILE, view_m)
    if (places.directory / LEFT_OUT_FILE).exists():
        left_out = np.load(places.directory / LEFT_OUT_FILE)
        np.save(out / LEFT_OUT_FILE, left_out)
        (out / FLOOR_FILE).write_text(json.dumps(_record(len(positions), len(left_out), places_m)))


def _record(reached: int, left_out: int, places_m: float) -> dict[str, float]:
    """How much floor the mapping run saw, and how much of it has no template because no step reaches it."""
    share = left_out / (reached + left_out)
    return {"seen_m2": round((reached + left_out) * places_m**2, 1), "without_template": round(share, 4)}


def _informative_mask(
    run: RunAt, places: StageResult, spacing_m: float, sensor: SensorModel
) -> NDArray[np.bool_] | None:
    """(n,) the places without those in the open that a neighbour stands for, and those that see nothing.

    None: there would be none left.
    """
    tiling = Tiling(spacing_m)
    tiles, start = (np.load(places.directory / f"{name}.npy").tolist() for name in ("tile", "tile_start"))
    chunks = [
        InformativeViewpoints((x, y), tiling, sensor, first, last)
        for (x, y), first, last in zip(tiles, start[:-1], start[1:], strict=True)
    ]
    keep = np.concatenate([part["keep"] for part in run(places, chunks)])
    return keep if keep.any() else None


def _looks(
    run: RunAt, places: StageResult, spacing_m: float, rows: NDArray[np.int64], sensor: SensorModel, name: str
) -> NDArray[np.float32]:
    """(k,) what ``LookChunk`` returns by a name for some rows of the places."""
    tiling = Tiling(spacing_m)
    tile = tiling.of(np.load(places.directory / "positions.npy", mmap_mode="r")[rows])
    tiles = in_order((x, y) for x, y in np.unique(tile, axis=0).tolist())
    chunks = [
        LookChunk(one, tiling, sensor, tuple(rows[(tile == one).all(axis=1)].tolist())) for one in tiles
    ]
    return np.concatenate([part[name] for part in run(places, chunks)])


def _numbered(positions: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """(n, 4) positions with their rows."""
    return np.column_stack([positions, np.arange(first, first + len(positions))])


def _shown(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of (n, 4) numbered places that tell how far one sees in a map."""
    return places[rows_by_hash(places[:, :3], VIEWPOINTS, VIEWPOINT_CELL_M)]
