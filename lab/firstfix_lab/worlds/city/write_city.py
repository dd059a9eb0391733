"""A city as files, block by block: no more than a few blocks are in memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.drive import drive
from firstfix_cli.sample_world.query import WorldQuery, queries
from firstfix_cli.sample_world.survey import Survey
from firstfix_cli.sample_world.write_world import ply_of_mesh, write_queries

from .city import City
from .layout import BLOCK_M

MAX_EXTENT_M = 20_000.0
BLOCKS_A_FILE = 4  # along x and along y
SEEN_BLOCKS = 2  # to every side of the block of a query: further than its sensor reaches
QUERIES = 26


def write_city(directory: Path, *, extent_m: float, seed: int = 0, count: int = QUERIES) -> City:
    """Write the true surfaces as a folder of meshes, and scans that were taken later at known poses.

    Files: mesh/XXX_YYY.ply, sensor.yaml, scans/NNN.pcd, poses.csv, README.txt. The same arguments give the
    same bytes.

    Args:
        extent_m: along x and y, to the nearest whole block.
        count: number of scans.

    Raises:
        InvalidOption: the extent is no extent, or the seed is negative.
    """
    if not BLOCK_M <= extent_m <= MAX_EXTENT_M:
        raise InvalidOption(f"the extent of a city is {BLOCK_M:g} to {MAX_EXTENT_M:g} m, not {extent_m:g}")
    if seed < 0:
        raise InvalidOption(f"a seed is 0 or more, not {seed}")
    city = City.of_extent(extent_m, seed)
    write_meshes(city, directory / "mesh")
    sensor = city.block(0, 0).sensor
    (directory / "sensor.yaml").write_text(yaml.safe_dump(sensor.to_mapping(), sort_keys=False))
    write_queries(directory, city_queries(city, count))
    (directory / "README.txt").write_text(_readme(city, sensor.name, count))
    return city


def write_meshes(city: City, folder: Path) -> None:
    """Write the meshes of some blocks each. The folder is a map's source."""
    folder.mkdir(parents=True, exist_ok=True)
    for x, y in product(range(0, city.side, BLOCKS_A_FILE), repeat=2):
        here = product(
            range(x, min(x + BLOCKS_A_FILE, city.side)), range(y, min(y + BLOCKS_A_FILE, city.side))
        )
        mesh = Mesh.joined(city.block(i, j).mesh() for i, j in here)
        (folder / f"{x:03}_{y:03}.ply").write_bytes(ply_of_mesh(mesh))


def city_queries(city: City, count: int) -> Iterator[WorldQuery]:
    """Yield scans in the streets of the city on another day, of a block drawn by chance each."""
    rng = np.random.default_rng([city.seed, 3])
    for _ in range(count):
        column, row = rng.integers(0, city.side, 2).tolist()
        place = city.around(column, row, SEEN_BLOCKS)
        T: NDArray[np.float64] = drive(place)
        inner = ((T[:, :2, 3] > 3) & (T[:, :2, 3] < city.side * BLOCK_M - 3)).all(axis=1)
        driven = T[inner] if inner.any() else T
        yield queries(place, Survey(driven, driven, np.zeros((0, 3))), 1, rng)[0]


def _readme(city: City, sensor: str, count: int) -> str:
    extent_m = city.side * BLOCK_M
    return f"""\
Sample city of firstfix, seed {city.seed}, {extent_m:g} x {extent_m:g} m. Made by a program; free to use.

mesh/        the true surfaces, some blocks a file: the folder is the source of a map
sensor.yaml  the LiDAR model ({sensor})
scans/       {count} query scans in the sensor frame, taken later: things have moved, people pass by
poses.csv    T_map_sensor of each query scan
"""
