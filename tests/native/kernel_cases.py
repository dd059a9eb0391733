"""One table of calls of the kernels: every function and class of ``firstfix.native`` stands in it.

A case is named after its kernel, with more words after a comma where there are several. As a program, it
prints the digest of each result: the instruction sets must agree.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig, PreprocessConfig
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.registration.surface_grid_build import BLOCK_BITS, CellsOf, tables_around
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.native import Step
from firstfix.scan.reduction import RangeView, directions
from firstfix.transform import make_transform

_RNG = np.random.default_rng(16)


def _street(count: int) -> NDArray[np.float32]:
    """Ground, two walls and clutter around a sensor 1.7 m above the ground."""
    share = count // 4
    ground = np.column_stack([_RNG.uniform(-40, 40, (share, 2)), np.full(share, -1.7)])
    walls = _RNG.uniform([-40, -7, -1.7], [40, 9, 8], (2 * share, 3))
    walls[:, 1] = np.where(walls[:, 1] < 1, -7.0, 9.0)
    clutter = _RNG.uniform([-40, -9, -1.7], [40, 9, 3], (count - 3 * share, 3))
    return (np.concatenate([ground, walls, clutter]) + _RNG.normal(0, 0.02, (count, 3))).astype(np.float32)


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float32]:
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


STREET = _street(20_011)
FEW = STREET[:3001]
NORMALS = _unit(_RNG.normal(size=(3001, 3)) * [0.1, 1, 0.5])
WIDE = _RNG.uniform(-9e6, 9e6, (2000, 3))  # more voxels than 32 bits can number
R_LEVEL_SENSOR = np.linalg.qr(_RNG.normal(size=(3, 3)))[0]
DIRECTIONS = _unit(_RNG.normal(size=(77, 3))).astype(np.float64)
EDGES_M = np.float32([0.3, 1.0, 1.8, 3.0, 6.0, 25.0])
OCCUPANCY = np.packbits(_RNG.random((40, 100 * 60)) < 0.1, axis=1)
YAWS_RAD = _RNG.uniform(-4, 4, 300)
START = np.array([0, 7000, 7000, len(STREET)])
CELLS = np.array([90, 90, 90])
OCTETS = _RNG.integers(0, 256, (12, 500), np.uint8)
SURFACE = Surface(FEW, NORMALS, NORMALS[:, 0] > 0)
ANGLES = np.stack([np.cos(np.arange(100) / 16), np.sin(np.arange(100) / 16)])
TIMES = _RNG.uniform(-0.05, 0.05, len(FEW)).astype(np.float32)
TWIST = np.array([1.0, -2.0, 0.1, 0.2, -0.1, 1.5])
T_MAP_SENSOR = make_transform(R_LEVEL_SENSOR, [1.0, -2.0, 0.5])


def _seen_surface(native: Any) -> Any:
    seen = native.SeenSurface(0.5)
    seen.add(FEW[:3] / 9, NORMALS, np.abs(FEW[:, :1]).repeat(3, axis=1).T.copy())
    return seen.means()


def _condensed(native: Any) -> Any:
    points, nearest_m, time_s, (occupancy, up, height_m) = native.condensed(
        FEW, TIMES, 0.5, 30.0, 0.3, 1.0, (20, 60, 40.0, EDGES_M), None, 400
    )
    return points, nearest_m, time_s, occupancy, up, height_m


def _cast(native: Any) -> Any:
    tree = native.TriangleTree(FEW, np.arange(3000, dtype=np.uint32).reshape(-1, 3))
    order = native.bundle_rays(NORMALS)
    beyond_m = np.abs(NORMALS[:, 0])
    return (
        tree.ranges(FEW[:2] / 9, NORMALS, order, 0.1, 60.0),
        tree.ranges_beyond(FEW[0] / 9, NORMALS, order, beyond_m, 60.0),
        tree.occupied_cells(FEW[:2] / 9, FEW[:2, 0], NORMALS, order, 0.1, 60.0, 20, 60, 40.0, EDGES_M),
        *tree.crossings(FEW[:, :2].astype(np.float64), 0.02, 9),
        tree.free_ways(FEW / 9, FEW / 8),
        tree.near_surface(FEW[::2] / 2, 0.3),
    )


def _grid(native: Any, cell_m: float = 0.5) -> Any:
    grid = SurfaceGrid.of(SURFACE, cell_m)
    tables = (grid.corner, grid.planes, grid.oriented, grid.other_face, grid.group, grid.block, grid.point)
    return native.SurfaceGrid(float(grid.cell[0]), *tables)


def _cells() -> tuple[NDArray[Any], ...]:
    cells = CellsOf.points(FEW, 0.5)
    return *cells.of(slice(None)), np.arange(len(FEW), dtype=np.int32), *tables_around(cells)


def _tiles(native: Any, voxel_m: float) -> Any:
    tiles = PointTiles.of(FEW, voxel_m)
    return native.PointTiles(tiles.points, tiles.begin, tiles.low)


def _aligned() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    return FEW[::5] + np.float32(0.05), NORMALS[::5], SURFACE.oriented[::5]


def _information() -> NDArray[np.float64]:
    J = np.random.default_rng(3).normal(size=(40, 6)) * [30, 20, 10, 1, 2, 0.01]
    return np.asarray(1e3 * J.T @ J, np.float64)


def _starts() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses, and the twists there."""
    return np.array([np.eye(4), T_MAP_SENSOR]), np.array([np.zeros(6), [0.4, -0.1, 0, 0, 0, 0.7]])


def _returns() -> NDArray[np.float32]:
    """Returns that half fit the tiles of ``_tiles``: every other one has come closer."""
    away = (FEW - T_MAP_SENSOR[:3, 3].astype(np.float32)) @ T_MAP_SENSOR[:3, :3].astype(np.float32)
    return np.ascontiguousarray(
        away * np.where(np.arange(len(FEW)) % 2, 0.6, 1.2)[:, None].astype(np.float32)
    )


def _view() -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    seen = RangeView.of(STREET)
    return seen.returned, seen.least


def _free(native: Any) -> tuple[NDArray[Any], ...]:
    """Free cells around two poses, of which the points of ``FEW`` are taken out."""
    cells = native.CarvedCells(0.25)
    ranges = np.abs(FEW[:, 0]) + np.float32(2)
    cells.add(FEW[:2].astype(np.float64) / 9, NORMALS, np.stack([ranges, ranges / 2]), 0.3)
    brick, once, twice = cells.bricks()
    return brick, once, twice, native.take_out_near(brick, once, FEW.astype(np.float64), 0.25)


def _seen_free(native: Any) -> Any:
    brick, *_, bits = _free(native)
    tables = SeenFree.of_bricks(brick, bits, 0.25)
    free = native.SeenFree(0.25, tables.corner, tables.group, tables.brick, tables.bits)
    return free.shares(FEW, np.array([np.eye(4), T_MAP_SENSOR])), free.holds(FEW, T_MAP_SENSOR)


def _places(native: Any) -> tuple[Any, Any]:
    """Twelve templates in a row on two floors, each with an alias on its own floor."""
    position_m = np.array([[i % 6, 0, 1 + 3 * (i // 6)] for i in range(12)], np.float32)
    tiles = TemplateTiles.of(position_m)
    places = native.TemplatePlaces(position_m, np.ones(12, np.float32), tiles.row, tiles.begin, tiles.low)
    row = np.array([[(i + 3) % 6 + 6 * (i // 6), -1] for i in range(12)], np.int32)
    turn = np.arange(24, dtype=np.uint8).reshape(12, 2) * 10
    return places, native.AliasTable(row, turn, turn[::-1].copy())


def _searched(native: Any) -> Any:
    """The map of ``_grid`` and ``_tiles``, and what was seen free in it."""
    brick, *_, bits = _free(native)
    free = SeenFree.of_bricks(brick, bits, 0.25)
    return native.SearchedMap(
        T_MAP_SENSOR,
        _grid(native),
        _grid(native, 1.5),
        *(_tiles(native, 0.2), _tiles(native, 0.4)),
        native.SeenFree(0.25, free.corner, free.group, free.brick, free.bits),
        *_places(native),
        30.0,
        1.0,
        *(CONFIG.registration, CONFIG.nearby, CONFIG.search.aliases, CONFIG.ranking, CALIBRATION),
        4,
        CONFIG.search,
        1.4,
        1.0,
    )


def _prepared(native: Any, scans: Any, twist: Any = None, gravity: Any = None, up: Any = None) -> Any:
    config = EngineConfig(preprocess=PreprocessConfig(min_points=10))
    numbers = config.preprocess, config.ranking
    return native.prepare(scans, gravity, UP if up is None else up, twist, *numbers)


def _query(native: Any, times: Any = None, **how: Any) -> Any:
    """A scan of the points of ``_aligned``."""
    few = _aligned()[0][::8].copy()
    return _prepared(
        native, [(np.eye(4), few, None if times is None else times[::40].copy(), None, None)], **how
    )


def _parts(query: Any) -> Any:
    """All that is in a prepared query, as one flat tuple."""
    parts: list[Any] = [query.spots, query.in_range, *query.dense(), *query.sparse()]
    for number in range(len(query)):
        *plain, returns, thinned = query.scan(number)
        parts += [*plain, *(returns or ()), *thinned]
    return tuple(parts)


def _compact(native: Any, described: Any) -> Any:
    return np.eye(4), FEW, TIMES, native.nearest_by_direction(STREET), described


def _search(native: Any, times: NDArray[np.float32] | None = None) -> Any:
    """Poses found by two runs, and what is asked of known aliases, of a scan as in ``_aligned``."""
    prior = np.eye(4), np.array([-6.0, 0, 0]), 10.0, 0.0, 180.0
    map_searched = _searched(native)
    search = native.Search(map_searched, _query(native, times), prior)
    starts, (_, twist) = _starts()
    rows, score = np.arange(2), np.array([0.5, 0.4])
    search.align(rows, starts, score)
    may_explain = search.may_explain_scan()
    first = search.run(rows, starts, score, None, starts[:0], True)
    second = search.run(rows + 2, starts @ T_MAP_SENSOR, score, twist, starts, False)
    return (
        *(one for found in (first, second) for pose in found for one in pose),
        may_explain,
        search.is_settled(),
        search.explains_scan(),
        search.is_accepted(0.5),
        *(stage for stage, _ in search.try_aliases(0.0, True)),
        *(one for pose in search.mark_look_alikes() for one in pose),
        len(search.aliases_outside()[0]),
        search.lead_outside(search),
        search.not_far_behind(starts, T_MAP_SENSOR, twist),
        *map_searched.known_aliases(T_MAP_SENSOR, None),
    )


def _ladder(native: Any, retrieval: Any) -> Any:
    """Poses found by all steps of the ladder, in two maps, of a scan as in ``_search``."""
    prior = np.eye(4), np.array([-6.0, 0, 0]), 10.0, 0.0, 180.0
    mounting = make_transform(R_LEVEL_SENSOR, [0.1, 0, 0.4])

    other_was = native.Cancellation(np.array([1], np.uint64), 2)

    def made(prior: Any, gravity: Any, most: int | None) -> Any:
        asked = prior, most, 0.1, np.inf, None if most is None else other_was
        return native.MapSearch(_searched(native), retrieval, _query(native, gravity=gravity), *asked)

    alone, one, other = made(prior, None, None), made(None, UP, 2), made(None, None, None)
    fits = [one.may_fit(0.3), alone.may_fit(1.0)]
    stages = alone.take(Step.NARROW)
    answers = native.answered([alone], False, None), native.answered([one, other], True, mounting)
    return (
        fits,
        *(stage for stage, _ in stages),
        *(number for search in (alone, one, other) for pose in search.found() for number in pose),
        *(number for answer in answers for number in _answer(*answer)),
        *(search.outside_lead for search in (alone, one, other)),
        *(step.name for search in (alone, one, other) for step in search.taken),
        alone.is_settled(),
    )


def _answer(reason: Any, probability: float, places: Any, placed: Any, stages: Any) -> Any:
    """All that is in an answer but times, as one flat tuple."""
    numbers = [number for *place, fit, share in places for number in (*place, *fit, share)]
    if placed is not None:
        T_map_base, covariance, free, twist = placed
        numbers += [T_map_base, covariance, twist, *(number for axis in free for number in axis)]
    return reason, probability, *numbers, *(stage for stage, _ in stages)


def _found_in_python(*levelling: Any) -> Any:
    """The first templates of any sphere, for a scan levelled in any way."""
    return lambda centre_m, radius_m, clusters: (
        np.arange(5),
        np.linspace(0, 2, 5),
        np.linspace(1, 0, 5, dtype=np.float32),
    )


CONFIG, CALIBRATION = EngineConfig(), Calibration(cases=5, among_tied=(-8.0, 1.0, 1.5, 2.0, 1.0, 9.0))
QUALITY = AlignmentQuality(0.8, 0.7, 0.02, 0.01, 0.05, 0.2, 0.1)
KEYS = _RNG.integers(0, 256, (40, 33), np.uint8)
PROJECTION = _RNG.normal(size=(100 * 8, 33)).astype(np.float32) / 99


GRID = 20, 60, 80.0, np.float32([0.3, 1.0, 1.8, 3.0, 6.0, 25.0])


def _cascade_tables(native: Any) -> Any:
    every = np.arange(41, dtype=np.int32)
    position_m = (STREET[:40] / 4).astype(np.float32)
    tiles = TemplateTiles.of(position_m)
    return native.Cascade(
        *(position_m, OCCUPANCY, *GRID, 8, every[:-1], every, every[:-1]),
        *(tiles.row, tiles.begin, tiles.low, PROJECTION, KEYS, -(NORMALS[:33, 0] ** 2), NORMALS[:33, 0] ** 2),
    )


def _cascade(native: Any) -> Any:
    cascade = _cascade_tables(native)
    return cascade.search(OCCUPANCY[3], 9), cascade.search_near(OCCUPANCY[3], np.zeros(3), 6.0, 5)


def _candidates(native: Any, *how: Any) -> Any:
    rows, height_m = np.arange(100, 0, -1), np.abs(STREET[:300, 2])
    matches = rows, YAWS_RAD[:100].copy(), NORMALS[:100, 0] ** 2
    return native.candidates_of(*matches, STREET[:300], height_m, R_LEVEL_SENSOR, 1.5, T_MAP_SENSOR, *how)


UP = np.array([0.1, -0.05, 0.9])


CASES: dict[str, Callable[[Any], Any]] = {
    "prepare": lambda n: _parts(_prepared(n, [(np.eye(4), STREET, None, None, None)], gravity=-UP)),
    "prepare, in time": lambda n: _parts(_prepared(n, [(np.eye(4), FEW, TIMES, None, None)])),
    "prepare, deskewed": lambda n: _parts(_prepared(n, [_compact(n, None)], TWIST)),
    "prepare, compact": lambda n: _parts(
        _prepared(
            n, [_compact(n, (*GRID, OCCUPANCY[3], UP, 1.5)), (T_MAP_SENSOR, FEW[:900], None, None, None)]
        )
    ),
    "scan_facts": lambda n: n.scan_facts(FEW[:500]),
    "is_spread_elsewhere": lambda n: n.is_spread_elsewhere(FEW[:500], 1.06, 4.0),
    "timed_view": lambda n: n.timed_view(FEW, TIMES, n.nearest_by_direction(STREET), directions()),
    "height_above_floor": lambda n: n.height_above_floor(
        FEW, np.tile(np.float32([0, 0, 1]), (len(FEW), 1)), UP
    ),
    "other_ups": lambda n: n.other_ups(NORMALS, UP, None),
    "level_hypotheses": lambda n: tuple(
        n.level_hypotheses(
            [(np.eye(4), R_LEVEL_SENSOR, FEW[: len(NORMALS)], NORMALS)],
            *(FEW[: len(NORMALS)], NORMALS, np.array([0.0, 0, 1]), 1.0, False),
        )
    ),
    "ladder": lambda n: _ladder(n, _found_in_python),
    "similar_places": lambda n: n.similar_places(
        *(_searched(n), _found_in_python, (R_LEVEL_SENSOR, 1.4), OCCUPANCY[3], None, 4, 9)
    ),
    "expected_s": lambda n: n.expected_s(Step.WIDE, CONFIG.search, 0.02),
    "range_view": lambda n: n.range_view(n.nearest_by_direction(STREET)),
    "rows_by_chance": lambda n: n.rows_by_chance(120_000, 7_001),
    "chosen_by_chance, float": lambda n: n.chosen_by_chance(STREET, 7_001),
    "chosen_by_chance, double": lambda n: n.chosen_by_chance(WIDE, 700),
    "within_range": lambda n: n.within_range(STREET, 0.5, 30.0),
    "first_in_voxel, float": lambda n: n.first_in_voxel(STREET, 0.3),
    "first_in_voxel, double": lambda n: n.first_in_voxel(WIDE, 50.0),
    "voxel_means, float": lambda n: n.voxel_means(STREET, 0.3),
    "voxel_means, double": lambda n: n.voxel_means(WIDE, 50.0),
    "voxel_means, moved borders": lambda n: n.voxel_means(STREET, 0.3, 0.0005),
    "rows_by_voxel_hash, float": lambda n: n.rows_by_voxel_hash(STREET, 0.3, 4000),
    "rows_by_voxel_hash, double": lambda n: n.rows_by_voxel_hash(WIDE, 50.0, 300),
    "turned, float": lambda n: n.turned(STREET, R_LEVEL_SENSOR),
    "turned, double": lambda n: n.turned(WIDE, R_LEVEL_SENSOR),
    "floor_height": lambda n: n.floor_height(FEW, np.tile(np.float32([0, 0, 1]), (len(FEW), 1))),
    "votes": lambda n: n.votes(NORMALS, DIRECTIONS),
    "refined_up": lambda n: n.refined_up(NORMALS, DIRECTIONS[0]),
    "deskew": lambda n: n.deskew(FEW, TIMES, TWIST),
    "voxel_mean_times, float": lambda n: n.voxel_mean_times(FEW, TIMES, 0.9),
    "voxel_mean_times, double": lambda n: n.voxel_mean_times(FEW.astype(np.float64), TIMES, 0.9, 0.1),
    "nearest_by_direction": lambda n: n.nearest_by_direction(STREET),
    "least_of_neighbours": lambda n: n.least_of_neighbours(n.nearest_by_direction(STREET).reshape(90, 180)),
    "condensed": lambda n: n.condensed(STREET, None, 0.5, 30.0, 0.3, 1.0, None, None, 900)[:2],
    "condensed, described": _condensed,
    "flat_patches": lambda n: n.flat_patches(n.voxel_means(STREET, 0.3), 0.9),
    "surface_normals": lambda n: n.surface_normals(FEW, -FEW),
    "surface_normals, two faces": lambda n: n.surface_normals(FEW, NORMALS, True),
    "thin_surface": lambda n: n.thin_surface(FEW, NORMALS, NORMALS[:, 0] > 0, 0.7),
    "occupied_cells": lambda n: n.occupied_cells(
        STREET, START, np.float32([1.7, 1.0, 1.5]), 20, 60, 40.0, EDGES_M
    ),
    "turned_occupied_cells": lambda n: n.turned_occupied_cells(
        STREET, R_LEVEL_SENSOR, 1.7, 20, 60, 40.0, EDGES_M
    ),
    "ring_spectra": lambda n: n.ring_spectra(OCCUPANCY, 100, 60, 8),
    "best_shifts": lambda n: n.best_shifts(OCCUPANCY[0], OCCUPANCY, np.arange(1, 40), 100, 60),
    "spread_out": lambda n: n.spread_out(STREET[:300].astype(np.float64), YAWS_RAD, 50, 3.0, np.cos(0.5), 3),
    "nearest_in_lists": lambda n: n.nearest_in_lists(
        FEW[:30], np.arange(90).reshape(30, 3) % 5, FEW, np.array([0, 7, 7, 60, 61, len(FEW)]), 40
    ),
    "Cascade": _cascade,
    "candidates_of": lambda n: _candidates(n, None, 20, (3.0, 0.9, 2)),
    "candidates_of, with headings": lambda n: _candidates(n, (T_MAP_SENSOR, 20.0, 50.0), 9, None),
    "usable_points, float": lambda n: n.usable_points(*STREET.T),
    "usable_points, double": lambda n: n.usable_points(*WIDE.T / 9e3),
    "all_within": lambda n: n.all_within(STREET, 30.0),
    "points_of_planes, 2 bytes": lambda n: n.points_of_planes(OCTETS[:6], 0.01, R_LEVEL_SENSOR[0]),
    "points_of_planes, 4 bytes": lambda n: n.points_of_planes(OCTETS, 1e-7, R_LEVEL_SENSOR[0]),
    "intensity_of_planes": lambda n: n.intensity_of_planes(OCTETS[:2], 0.3, -1.0),
    "range_image_points": lambda n: n.range_image_points(
        OCTETS[0, :250] & 0x11, OCTETS[1] & 0x7F, 500, 0.02, ANGLES, ANGLES
    ),
    "compact_points": lambda n: n.compact_points(
        OCTETS[:4] * np.uint8([[1], [0], [0], [0]]), OCTETS[4:6].ravel(), np.array([-9, 0, 7]), CELLS, 0.02
    ),
    "compact_planes": lambda n: n.compact_planes(FEW, 0.02),
    "levels_of_ranges": lambda n: n.levels_of_ranges(n.nearest_by_direction(STREET), EDGES_M),
    "ranges_of_levels": lambda n: n.ranges_of_levels(
        np.concatenate([np.full(50, 255, np.uint8), OCTETS[0, :400]]),
        np.arange(256, dtype=np.float32) / 3,
        400,
    ),
    "column_means": lambda n: n.column_means(np.column_stack([FEW, NORMALS]).astype(float), 0.7),
    "cell_planes": lambda n: n.cell_planes(STREET.astype(float), 0.6),
    "surface_net": lambda n: n.surface_net(
        *n.cell_planes(STREET.astype(float), 0.6)[:3], STREET.astype(float)[::3], 0.6, 2.0, 1.25
    ),
    "with_neighbours": lambda n: n.with_neighbours(FEW.astype(float), 0.5, 3),
    "in_sight": lambda n: n.in_sight(
        (STREET[:4096, 0] > 30).astype(np.uint8).reshape(16, 16, 16),
        np.array([-60, -20, -8]),
        0.4,
        *(one.astype(float) for one in (FEW, NORMALS, FEW[::-1].copy())),
        1.5,
        16,
    ),
    "by_first_use": lambda n: n.by_first_use(
        np.arange(3000).reshape(-1, 3) * 7 % 500, np.array([0, 10, 10, 700, 1000]), 500
    ),
    "SeenSurface": _seen_surface,
    "bundle_rays": lambda n: n.bundle_rays(NORMALS),
    "TriangleTree": _cast,
    "SurfaceGrid": lambda n: _grid(n).nearest(FEW[::3]),
    "nearest_points": lambda n: n.nearest_points(*_cells(), BLOCK_BITS, 1, 40),
    "align": lambda n: n.align(_grid(n), *_aligned(), np.eye(4)[None], 5, 0.4, 0.5, 0.13),
    "agreement": lambda n: n.agreement(
        _grid(n), _grid(n, 1.5), *_aligned(), np.array([np.eye(4), T_MAP_SENSOR]), 0.13
    ),
    "faced_information": lambda n: n.faced_information(_grid(n), FEW, T_MAP_SENSOR, _information(), 0.4),
    "pose_covariance": lambda n: n.pose_covariance(_information(), T_MAP_SENSOR, 0.1),
    "free_axes": lambda n: tuple(n.free_axes(_information(), 0.2, 0.03)),
    "align_moving": lambda n: n.align_moving(
        _grid(n), *_aligned(), TIMES[::5], *_starts(), np.ones(6), 5, 0.4, 0.5, 0.13
    ),
    "distinct_poses": lambda n: n.distinct_poses(
        np.array([make_transform(np.eye(3), at) for at in FEW[:200] / 20]), 0.5, 0.2, 50
    ),
    "PointTiles": lambda n: _tiles(n, 0.2).nearest_by_direction(T_MAP_SENSOR, 30.0),
    "seen_through": lambda n: n.seen_through(
        _tiles(n, 0.2), _tiles(n, 0.4), 40.0, _grid(n), *_view(), T_MAP_SENSOR
    ),
    "CarvedCells": lambda n: _free(n)[:3],
    "take_out_near": lambda n: _free(n)[3],
    "SeenFree": _seen_free,
    "compare_points": lambda n: n.compare_points(
        _tiles(n, 0.2), _tiles(n, 0.4), 9.0, 25.0, T_MAP_SENSOR, _returns(), 360
    ),
    "unexplained_returns": lambda n: n.unexplained_returns(
        _returns(), FEW, _grid(n), _grid(n, 1.5), T_MAP_SENSOR, FEW[:5] / 40, FEW[5:7] / 40, 25.0
    ),
    "Search": _search,
    "TemplatePlaces": lambda n: _places(n)[0].stacked(T_MAP_SENSOR),
    "AliasTable": lambda n: _places(n)[1].of(np.arange(12)),
    "Search, a scan in motion": lambda n: _search(n, TIMES),
    "support": lambda n: n.support(CONFIG.ranking, QUALITY),
    "contradiction": lambda n: n.contradiction(CONFIG.ranking, QUALITY),
    "discounted_score": lambda n: n.discounted_score(CONFIG.ranking, 0.8, TWIST),
    "margin_and_tied": lambda n: n.margin_and_tied([0.5, 0.45, 0.3, 0.1], 0, 0.1, 0.25),
    "match_inputs": lambda n: n.match_inputs(CONFIG.ranking, QUALITY, 0.2),
    "probability": lambda n: n.probability(CALIBRATION, CONFIG.ranking, QUALITY, 0.2, 1),
    "accepts": lambda n: n.accepts(CALIBRATION, CONFIG.ranking, QUALITY, 0.2, 1, 0.5),
    "may_lack": lambda n: n.may_lack(CONFIG.ranking, 0.6, QUALITY, QUALITY),
    "is_one_thing": lambda n: n.is_one_thing(CONFIG.ranking, QUALITY, QUALITY),
    "are_parted": lambda n: n.are_parted(
        np.array([0, 0.1, 0.2]), np.arange(3) == 2, FEW[:3].astype(np.float64)
    ),
    "decided": lambda n: n.decided(
        [(CONFIG.ranking, CALIBRATION)] * 2,
        [(i % 2, QUALITY, 0.9 - i * 0.04, 1, i == 2, 0.1 * i, True, False) for i in range(5)],
        None,
    ),
    "pose_product": lambda n: n.pose_product(T_MAP_SENSOR, T_MAP_SENSOR),
    "is_stacked": lambda n: n.is_stacked(np.zeros(3), FEW[:300].astype(np.float64) / 9),
    "is_any_of": lambda n: n.is_any_of(*[_starts()[0]] * 2, 1.0, 0.2),
    "cell_counts": lambda n: n.cell_counts(
        *(R_LEVEL_SENSOR.astype(np.float32) * 2, np.float32([51.2, 51.7, 51.5]), 103),
        *(FEW, NORMALS[:, 0] > 0, NORMALS[:, 1] > 0, FEW, NORMALS[:, 2] > 0),
        *(NORMALS[:500], FEW[:500, 0], 0.5),
    ),
}


def parts_of(result: Any) -> list[Any]:
    """The arrays and numbers of a result, tuples in tuples taken apart, without None."""
    if isinstance(result, tuple):
        return [one for part in result for one in parts_of(part)]
    return [] if result is None else [result]


def digest(result: Any) -> str:
    """SHA-256 of a result's bytes, types and shapes."""
    whole = hashlib.sha256()
    for part in map(np.asarray, parts_of(result)):
        whole.update(f"{part.dtype} {part.shape} ".encode() + part.tobytes())
    return whole.hexdigest()


if __name__ == "__main__":
    import firstfix.native

    print(json.dumps({name: digest(call(firstfix.native)) for name, call in CASES.items()}))
