"""Samples the sensor positions of the templates, over the floors that a robot can reach (paper III.A).

Tile by tile: each tile's floors are found alone, then the parts of tiles are joined, and those of them that
robots drive on give the viewpoints. So does other floor where the mapping run stopped and went, if it saw it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.errors import BuildFailed

from ..simulation.simulate import Simulator
from .even_sample import FloorPoints, one_per_block
from .joined_parts import JoinedParts
from .seen_floor import Kept, MappingRun, TileFloor, is_sparse, poses_near, seen_beyond, seen_from
from .tile_floors import FloorSampling, TileFloors, tile_floors
from .tiles import Tiling
from .trajectory_floor import Track, mount_height_m

DEFAULT_SPACING_M = 1.0

NO_FLOOR = np.zeros((0, 3))


@dataclass(frozen=True)
class Viewpoints:
    """Sensor positions of the templates.

    Attributes:
        positions: (n, 3) of the sensor, metres, map frame.
        floor_z: (n,) height of the floor below each.
        mount_height_m: the difference.
        left_out: (k, 3) the floor that the mapping run saw, and that has no viewpoint because no step reaches
            it: one place for each block and storey. None: the map has no trajectory.
    """

    positions: NDArray[np.float64]
    floor_z: NDArray[np.float64]
    mount_height_m: float
    left_out: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.positions)

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Viewpoints:
        """The chosen viewpoints."""
        return Viewpoints(self.positions[keep], self.floor_z[keep], self.mount_height_m, self.left_out)


def joined_viewpoints(
    sampling: FloorSampling,
    tiles: Sequence[tuple[int, int]],
    found: Iterable[TileFloors],
    keep: Callable[[int, TileFloors], None],
    kept: Kept,
    mapping: MappingRun | None,
) -> Iterator[Viewpoints]:
    """Yield the viewpoints of one tile after the other.

    Args:
        tiles: in order.
        found: the floors of each. One is in memory at a time.
        keep: called with each tile's number and floors: remembers their points.
        kept: returns a tile's points with their parts.
        mapping: its trajectory passed over what is driven on; None: there is no trajectory.

    Raises:
        BuildFailed: there is no floor to stand on, or none under the trajectory.
    """
    parts = JoinedParts()
    for number, (tile, floors) in enumerate(zip(tiles, found, strict=True)):
        parts.add(tile, floors)
        keep(number, floors)
    chosen = parts.chosen(by_trajectory=mapping is not None)
    if len(chosen) == 0:
        near = "" if mapping is None else " near the trajectory"
        raise BuildFailed(f"the map has no floor with room for the robot{near}")
    if not chosen.any():
        raise BuildFailed("no floor of the map lies under the trajectory: another frame?")
    seen = {} if mapping is None else seen_beyond(tiles, sampling.tiling.cell_m, parts, chosen, kept, mapping)
    for number in range(len(tiles)):
        points, part = kept(number)
        here = chosen[parts.parts_of(number)][part]
        beyond = seen.get(number, np.zeros(len(part), np.bool_))
        if mapping is None or mapping.is_sparse:
            yield _viewpoints(points.subset(here | beyond), sampling, None if mapping is None else NO_FLOOR)
        else:
            yield _viewpoints(points.subset(here), sampling, _left_out(points, here, beyond, sampling))


def _left_out(
    points: FloorPoints, here: NDArray[np.bool_], beyond: NDArray[np.bool_], sampling: FloorSampling
) -> NDArray[np.float64]:
    """(k, 3) one place for each block and storey with floor that was seen beyond, and none that is here."""
    group, _ = one_per_block(points, sampling.tiling.spacing_m)
    row = np.flatnonzero(beyond & ~np.isin(group, group[here]))
    row = row[np.unique(group[row], return_index=True)[1]]
    return np.column_stack([points.xy_m[row], points.z[row]])


def sample_viewpoints(
    simulator: Simulator,
    config: ViewpointConfig,
    sensor_height_m: float,
    trajectory: NDArray[np.float64] | None = None,
) -> Viewpoints:
    """Viewpoints of a map that is small, on every floor that is reached from the trajectory.

    Without one, on the largest floor that is no roof and on storeys of comparable size.

    Args:
        sensor_height_m: the sensor model's, for mount_height_m = "auto" without a trajectory.
        trajectory: (m, 4, 4) T_map_sensor, or None.

    Raises:
        BuildFailed: there is no floor to stand on, none under the trajectory, or the map is too large.
    """
    tiling = Tiling(config.spacing_m or DEFAULT_SPACING_M)
    positions = None if trajectory is None or not len(trajectory) else trajectory[:, :3, 3]
    drop_m = None if positions is None else simulator.drops(positions)
    sampling = floor_sampling(tiling, config, sensor_height_m, drop_m)
    track = None if positions is None else Track.of(positions, tiling.cell_m / 2)
    tiles = tiling.over(simulator.low[None, :2], simulator.high[None, :2])
    found: list[TileFloors] = []
    parts = joined_viewpoints(
        sampling,
        tiles,
        (tile_floors(simulator, sampling, tile, foot_near(track, sampling, tile)) for tile in tiles),
        lambda number, floors: found.append(floors),
        lambda number: (found[number].floor_points, found[number].part),
        None if positions is None else _mapping_in(simulator, tiling, positions),
    )
    every = list(parts)
    left_out = [one.left_out for one in every if one.left_out is not None]
    return Viewpoints(
        np.concatenate([one.positions for one in every]),
        np.concatenate([one.floor_z for one in every]),
        sampling.mount_height_m,
        np.concatenate(left_out) if left_out else None,
    )


def _mapping_in(simulator: Simulator, tiling: Tiling, positions: NDArray[np.float64]) -> MappingRun:
    def sees(floor: Sequence[TileFloor]) -> Iterator[NDArray[np.bool_]]:
        for tile, places in floor:
            yield seen_from(simulator, places, poses_near(positions, *tiling.box(tile)))

    return MappingRun(is_sparse(positions), sees)


def floor_sampling(
    tiling: Tiling, config: ViewpointConfig, sensor_height_m: float, drop_m: NDArray[np.float64] | None
) -> FloorSampling:
    """How floors are sampled.

    Args:
        sensor_height_m: the sensor model's.
        drop_m: (m,) heights of the trajectory over the surfaces below it; None: there is none.
    """
    track_m = sensor_height_m if drop_m is None else mount_height_m(drop_m, sensor_height_m)
    return FloorSampling(
        tiling, config, track_m if config.mount_height_m == "auto" else config.mount_height_m, track_m
    )


def foot_near(
    track: Track | None, sampling: FloorSampling, tile: tuple[int, int]
) -> NDArray[np.float64] | None:
    """(k, 3) points under the trajectory that decide on the floors of a tile; None: there is none."""
    if track is None:
        return None
    low, high = sampling.tiling.box(tile)
    reach_m = sampling.reach_m + (sampling.config.max_distance_to_trajectory_m or 0.0)
    return track.near(low - reach_m, high + reach_m, sampling.track_height_m)


def _viewpoints(
    points: FloorPoints, sampling: FloorSampling, left_out: NDArray[np.float64] | None
) -> Viewpoints:
    """For each block of the spacing and each storey in it, the floor nearest to the block's centre."""
    _, first = one_per_block(points, sampling.tiling.spacing_m)
    floor_z = points.z[first]
    positions = np.column_stack([points.xy_m[first], floor_z + sampling.mount_height_m])
    return Viewpoints(positions, floor_z, sampling.mount_height_m, left_out)
