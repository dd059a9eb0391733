"""The index of a provisional version: its templates are the map's own points, seen from the mapping run."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.builds.config import BuildConfig
from firstfix.descriptor import Described, ScanBatch
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.registration.surface import Surface
from firstfix.engine.retrieval.cascade import Clusters, Templates
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.errors import BuildFailed
from firstfix.scan.reduction import first_in_voxel

from ..index.index_files import write_search, write_surface
from ..mesh.clean_cloud import voxel_means
from ..sources.check_map.floors_under import FloorsUnder
from ..sources.read_map.posed_cloud import PosedCloud
from ..templates.fit_engine import fit_engine
from ..templates.fit_spacing import ROOM_SPACING_M, ROOM_VIEW_M
from ..templates.view_distance import percentile_m
from ..viewpoints.sample import DEFAULT_SPACING_M
from ..viewpoints.trajectory_floor import mount_height_m
from .sensor_view import SensorView

MAX_POINTS = 350_000  # of the surface: of a larger map they are further apart
MAX_PLACES = 10_000  # of templates: a longer run is not made ready within seconds
VOXELS_A_VIEW = 150  # templates see points that are this part of the view distance apart, or more
MAX_VOXEL_M = 0.4  # between these points
LOOKS = 24  # places that tell how far one sees
DIRECTIONS = 180  # of each of them
PLACES_AT_ONCE = 32


@dataclass(frozen=True)
class QuickPlaces:
    """Places of the templates, on the way of the mapping run.

    Attributes:
        at: (n, 3) metres, in the order of the run.
        spacing_m: the usual distance from one to the next.
    """

    at: NDArray[np.float64]
    spacing_m: float

    @classmethod
    def along(cls, run: NDArray[np.float64], spacing_m: float) -> QuickPlaces:
        """Some of (m, 3) positions: the first in each cube of so large an edge, however often it is passed.

        Raises:
            BuildFailed: the run is so long that templates would take minutes.
        """
        kept = first_in_voxel(run, spacing_m)
        if len(kept) > MAX_PLACES:
            raise BuildFailed(f"the mapping run is longer than {MAX_PLACES} templates")
        at = run[kept]
        steps_m = np.linalg.norm(np.diff(at, axis=0), axis=1)
        return cls(at, round(float(max(spacing_m, np.median(steps_m))), 2) if len(steps_m) else spacing_m)


def write_quick_index(cloud: PosedCloud, config: BuildConfig, threads: Executor, out: Path) -> QuickPlaces:
    """Write all files of a version but those of a self-test.

    Args:
        out: an empty folder.

    Raises:
        BuildFailed: the map is too large for it.
    """
    sensor, run = config.sensor_model, cloud.trajectory[:, :3, 3]
    voxel_m, thin = _thinned(cloud)
    view = SensorView.of(sensor)
    view_m = _view_m(PointTiles.of(thin, MAX_VOXEL_M), run, view, config)
    usual_m = ROOM_SPACING_M if view_m < ROOM_VIEW_M else DEFAULT_SPACING_M
    places = QuickPlaces.along(run, config.viewpoints.spacing_m or usual_m)
    engine = fit_engine(config.engine, sensor, voxel_m / 1.25, view_m, places.spacing_m, cloud.T_map_level)
    (out / ENGINE_FILE).write_text(engine.model_dump_json())
    height_m = mount_height_m(FloorsUnder.of(thin, cloud.trajectory).height_m, sensor.mount_height_m)
    toward = places.at[cKDTree(places.at).query(thin)[1]] - thin
    surface = threads.submit(Surface.around, thin, toward)
    tiles = PointTiles.of(thin, min(max(voxel_m, view_m / VOXELS_A_VIEW), MAX_VOXEL_M))
    templates = _templates(tiles, places, height_m, view, engine, threads)
    templates.save(out)
    Clusters.alone(len(templates)).save(out)
    write_search(out, templates, engine, provisional=True)
    write_surface(out, surface.result(), engine, templates, provisional=True)
    return places


def _thinned(cloud: PosedCloud) -> tuple[float, NDArray[np.float64]]:
    """The edge of the voxels of (k, 3) points that stand for the map, and these points."""
    voxel_m = float(np.clip(1.25 * cloud.spacing_m, 0.1, 0.3))
    thin = voxel_means(cloud.points, voxel_m)
    while len(thin) > MAX_POINTS:
        voxel_m *= max(1.1, float(np.sqrt(len(thin) / MAX_POINTS)))
        thin = voxel_means(thin, voxel_m)
    return voxel_m, thin


def _view_m(tiles: PointTiles, run: NDArray[np.float64], view: SensorView, config: BuildConfig) -> float:
    """Metres that one sees from the run: of some places, the furthest point in each horizontal direction."""
    furthest = []
    for position in run[rows_by_chance(len(run), LOOKS)]:
        near = tiles.around(position[:2], view.max_range_m) - position.astype(np.float32)
        x, y, _ = view.seen(near).T
        direction = np.floor(np.arctan2(y, x) * (DIRECTIONS / (2 * np.pi))).astype(np.int64) % DIRECTIONS
        away_m = np.zeros(DIRECTIONS, np.float32)
        np.maximum.at(away_m, direction, np.hypot(x, y))
        furthest.append(away_m)
    return percentile_m(np.concatenate(furthest), config.sensor_model)


def _templates(
    tiles: PointTiles,
    places: QuickPlaces,
    height_m: float,
    view: SensorView,
    engine: EngineConfig,
    threads: Executor,
) -> Templates:
    """The templates of all places, each described by the points that are seen from it."""
    descriptor = engine.descriptor.make()
    reach_m = min(view.max_range_m, engine.descriptor.grid.max_range_m)

    def described(rows: slice) -> Described:
        seen = [view.seen(tiles.around(at[:2], reach_m) - at.astype(np.float32)) for at in places.at[rows]]
        start = np.concatenate([[0], np.cumsum([len(one) for one in seen])])
        heights_m = np.full(len(seen), height_m, np.float32)
        return descriptor.describe(ScanBatch(np.concatenate(seen), start, heights_m))

    parts = list(threads.map(described, _runs(len(places.at))))
    of_all = {name: np.concatenate([part[name] for part in parts]) for name in descriptor.arrays}
    return Templates(places.at.astype(np.float32), np.full(len(places.at), height_m, np.float32), of_all)


def _runs(count: int) -> Iterator[slice]:
    return (slice(first, first + PLACES_AT_ONCE) for first in range(0, count, PLACES_AT_ONCE))
