"""From the map cloud to a surface that rays can hit, in overlapping squares of bounded size."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from firstfix.build_config import ReconstructConfig
from firstfix.errors import BuildCancelled, BuildFailed

from .clean_cloud import surface_spacing_m
from .mesh import Mesh
from .poisson import Tile, poisson_tile
from .squares import Square, occupied_squares

IN_FLIGHT = 16  # tiles handed out at a time: all of them at once would hold a large cloud twice
POLL_S = 0.5
PLACE_STEP_M = 0.5
SIGHT_RANGE_M = 100.0  # a scanner further than this from a square was not what saw it
SIGHT_CELLS = 1.5


def reconstruct_mesh(
    points: NDArray[np.float64],
    trajectory: NDArray[np.float64] | None,
    config: ReconstructConfig,
    *,
    executor: Executor | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Mesh:
    """The surface of a map cloud; the same bytes with any executor.

    Open3D's Poisson keeps the interpreter lock: an executor of processes (or machines) is what makes
    tiles run side by side, threads do not.

    Args:
        points: (n, 3) metres, cleaned.
        trajectory: (m, 4, 4) T_map_sensor where the scanner was, or None.
        executor: tiles are mapped over it; None works in this thread.
        progress: told the share done, 0 to 1.
        cancelled: asked between tiles.

    Raises:
        BuildFailed: too few points, or no surface comes out.
        BuildCancelled: cancelled() said so.
    """
    if len(points) < 100:
        raise BuildFailed(f"a map of {len(points)} points has no surface")
    places = None if trajectory is None else _thinned(trajectory[:, :3, 3])
    spacing_m = surface_spacing_m(points)
    cell_m = config.cell_m or config.cell_spacings * spacing_m
    squares = occupied_squares(points, config.tile_cells * cell_m)
    margin_m = config.margin_cells * cell_m

    def tile_of(square: Square) -> Tile:
        return Tile(
            points=points[square.holds(points, margin_m)],
            places=None if places is None else places[square.holds(places, SIGHT_RANGE_M)],
            low=square.low,
            high=square.high,
            cell_m=cell_m,
            point_weight=config.point_weight,
            trim_m=config.trim_spacings * spacing_m,
            normal_radius_m=config.normal_spacings * spacing_m,
            normal_neighbours=config.normal_neighbours,
            sight_voxel_m=SIGHT_CELLS * cell_m,
        )

    meshes = []
    for mesh in _mapped((tile_of(square) for square in squares), executor, cancelled):
        meshes.append(mesh)
        progress(len(meshes) / len(squares))
    mesh = Mesh.joined(meshes)
    if len(mesh.triangles) == 0:
        raise BuildFailed("the map gives no surface: its points are too sparse or too scattered")
    return mesh


def _mapped(
    tiles: Iterator[Tile], executor: Executor | None, cancelled: Callable[[], bool]
) -> Iterator[Mesh]:
    """The mesh of every tile, in order, with a bounded number of tiles under way."""
    under_way: deque[Future[Mesh]] = deque()
    try:
        while True:
            if cancelled():
                raise BuildCancelled("cancelled while the mesh was made")
            if executor is None:
                tile = next(tiles, None)
                if tile is None:
                    return
                yield poisson_tile(tile)
                continue
            for tile in islice(tiles, IN_FLIGHT - len(under_way)):
                under_way.append(executor.submit(poisson_tile, tile))
            if not under_way:
                return
            try:
                mesh = under_way[0].result(timeout=POLL_S)
            except TimeoutError:
                continue
            except BrokenExecutor as error:
                raise BuildFailed("a worker died while the mesh was made, maybe out of memory") from error
            under_way.popleft()
            yield mesh
    finally:
        for future in under_way:
            future.cancel()


def _thinned(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """One position of every half metre: a scanner that stood still is no better evidence."""
    _, first = np.unique(np.floor(positions / PLACE_STEP_M), axis=0, return_index=True)
    return positions[np.sort(first)]
