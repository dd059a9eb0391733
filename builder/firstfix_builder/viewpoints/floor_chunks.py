"""The tiles of a map that viewpoints are sampled in, as chunks: each reads the mesh around it alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig

from ..execution.chunks import Arrays, Chunk
from ..execution.stage_cache import StageResult
from ..mesh.places.surface_cells import surface_cells_of
from ..mesh.tiled_mesh import TiledMesh
from ..simulation.local_simulator import local_simulator
from ..simulation.simulate import Simulator
from ..stage_files import TRAJECTORY_FILE
from .even_sample import FloorPoints
from .sample import Viewpoints, floor_sampling, foot_near, joined_viewpoints
from .seen_floor import SIGHT_M, MappingRun, TileFloor, is_sparse, poses_near, seen_from
from .tile_floors import FloorSampling, TileFloors, tile_floors
from .tiles import SHARED_TILES, Tiling, in_order
from .trajectory_floor import Track

_SPOT = np.dtype([("xy", "<f8", 2), ("z", "<f8"), ("low", "<f8"), ("high", "<f8"), ("part", "<i4")])


@dataclass(frozen=True)
class TileChunk(Chunk):
    """Work in one tile. Reads the input ``mesh``.

    Attributes:
        tile: its number in x and y.
    """

    tile: tuple[int, int]
    tiling: Tiling

    def simulator(self, mesh: Path, reach_m: float) -> Simulator:
        """A simulator for rays up to reach_m from the tile."""
        side_m = SHARED_TILES * self.tiling.side_m
        low = np.floor_divide(self.tile, SHARED_TILES) * side_m
        return local_simulator(mesh, low, low + side_m, reach_m)

    def surface(self, mesh: StageResult, reach_m: float) -> str:
        """A hash of the surface within reach_m of the tile."""
        return surface_cells_of(mesh.directory).digest_within(*self.tiling.box(self.tile), reach_m)


@dataclass(frozen=True)
class DropsChunk(TileChunk):
    """Height of the trajectory's poses over the surfaces below them. Reads the input ``map``."""

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The drop of each pose over the tile, inf where nothing is below."""
        return {"drop_m": self.simulator(inputs["mesh"], 0.0).drops(self._positions(inputs["map"]))}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the poses over the tile, and of the surface there."""
        positions = self._positions(inputs["map"].directory)
        return {
            "positions": sha256(positions.tobytes()).hexdigest(),
            "mesh": self.surface(inputs["mesh"], 0.0),
        }

    def _positions(self, folder: Path) -> NDArray[np.float64]:
        return _poses(folder).near(*self.tiling.box(self.tile), 0.0)


@dataclass(frozen=True)
class FloorsChunk(TileChunk):
    """The floors of a tile. Reads the input ``map`` where there is a trajectory."""

    sampling: FloorSampling
    has_track: bool

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The arrays of ``TileFloors``."""
        simulator = self.simulator(inputs["mesh"], self.sampling.reach_m)
        return _arrays(tile_floors(simulator, self.sampling, self.tile, self._foot(inputs["map"])))

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the surface and of the trajectory around the tile."""
        foot = self._foot(inputs["map"].directory)
        return {
            "foot": "none" if foot is None else sha256(foot.tobytes()).hexdigest(),
            "mesh": self.surface(inputs["mesh"], self.sampling.reach_m),
        }

    def _foot(self, folder: Path) -> NDArray[np.float64] | None:
        track = _track(folder, self.tiling.cell_m / 2) if self.has_track else None
        return foot_near(track, self.sampling, self.tile)


@dataclass(frozen=True)
class SeenFloorChunk(TileChunk):
    """Whether the mapping run saw some floor of a tile. Reads the input ``map``.

    Attributes:
        floor: (n, 3) places.
    """

    floor: NDArray[np.float64]

    @property
    def values(self) -> dict[str, Any]:
        """A hash of the places, which say where they are."""
        return {"floor": sha256(self.floor.tobytes()).hexdigest()}

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Which places were seen."""
        return {
            "seen": seen_from(self.simulator(inputs["mesh"], SIGHT_M), self.floor, self._near(inputs["map"]))
        }

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the poses near the tile, and of the surface between."""
        return {
            "poses": sha256(self._near(inputs["map"].directory).tobytes()).hexdigest(),
            "mesh": self.surface(inputs["mesh"], SIGHT_M),
        }

    def _near(self, folder: Path) -> NDArray[np.float64]:
        return poses_near(_poses(folder).points, *self.tiling.box(self.tile))


def tiled_viewpoints(
    run: Callable[[Sequence[Chunk]], Iterator[Arrays]],
    read: Path,
    mesh: Path,
    config: ViewpointConfig,
    spacing_m: float,
    sensor_height_m: float,
) -> tuple[Tiling, Iterator[tuple[tuple[int, int], Viewpoints]]]:
    """The viewpoints of every tile that has some, one after the other.

    Args:
        run: runs chunks that read the inputs ``map`` and ``mesh``.
        read, mesh: folders of these.
        spacing_m: between viewpoints.
        sensor_height_m: the sensor model's mount height.

    Raises:
        BuildFailed: there is no floor to stand on, none under the trajectory, or the map is too large.
    """
    tiling = Tiling(spacing_m)

    def sees(floor: Sequence[TileFloor]) -> Iterator[NDArray[np.bool_]]:
        return (part["seen"] for part in run([SeenFloorChunk(tile, tiling, at) for tile, at in floor]))

    tiled = TiledMesh.load(mesh)
    tiles = tiling.over(tiled.low, tiled.high)
    drop_m = mapping = None
    if (read / TRAJECTORY_FILE).exists() and len(_poses(read).points):
        over = np.unique(tiling.of(_poses(read).points), axis=0).tolist()
        under = [DropsChunk(tile, tiling) for tile in in_order((x, y) for x, y in over)]
        drop_m = np.concatenate([part["drop_m"] for part in run(under)])
        mapping = MappingRun(is_sparse(_poses(read).points), sees)
    sampling = floor_sampling(tiling, config, sensor_height_m, drop_m)
    chunks = [FloorsChunk(tile, tiling, sampling, drop_m is not None) for tile in tiles]
    return tiling, _in_tiles(sampling, tiles, (_floors(part) for part in run(chunks)), mapping)


def _in_tiles(
    sampling: FloorSampling,
    tiles: list[tuple[int, int]],
    found: Iterator[TileFloors],
    mapping: MappingRun | None,
) -> Iterator[tuple[tuple[int, int], Viewpoints]]:
    """Yield viewpoints by tile. What may become viewpoints is kept on the disk."""
    with TemporaryFile() as file:
        start = [0]

        def keep(number: int, floors: TileFloors) -> None:
            rows = np.empty(len(floors.part), _SPOT)
            points = floors.floor_points
            rows["xy"], rows["z"], rows["low"], rows["high"] = (
                points.xy_m,
                points.z,
                points.low_z,
                points.high_z,
            )
            rows["part"] = floors.part
            file.write(rows.tobytes())
            start.append(start[-1] + len(rows))

        def kept(number: int) -> tuple[FloorPoints, NDArray[np.int32]]:
            file.seek(start[number] * _SPOT.itemsize)
            rows = np.frombuffer(file.read((start[number + 1] - start[number]) * _SPOT.itemsize), _SPOT)
            return FloorPoints(rows["xy"], rows["z"], rows["low"], rows["high"]), rows["part"]

        parts = joined_viewpoints(sampling, tiles, found, keep, kept, mapping)
        for tile, viewpoints in zip(tiles, parts, strict=True):
            if len(viewpoints) or (viewpoints.left_out is not None and len(viewpoints.left_out)):
                yield tile, viewpoints


def _arrays(floors: TileFloors) -> Arrays:
    points = {
        f"point_{field.name}": getattr(floors.floor_points, field.name) for field in fields(FloorPoints)
    }
    others = {
        field.name: getattr(floors, field.name) for field in fields(floors) if field.name != "floor_points"
    }
    return {**points, **others}


def _floors(arrays: Arrays) -> TileFloors:
    points = FloorPoints(*(arrays[f"point_{field.name}"] for field in fields(FloorPoints)))
    return TileFloors(
        points, **{name: value for name, value in arrays.items() if not name.startswith("point_")}
    )


@lru_cache(2)
def _poses(read: Path) -> Track:
    """The positions of the poses themselves."""
    return Track(np.ascontiguousarray(np.load(read / TRAJECTORY_FILE, mmap_mode="r")[:, :3, 3]))


@lru_cache(2)
def _track(read: Path, step_m: float) -> Track:
    return Track.of(_poses(read).points, step_m)
