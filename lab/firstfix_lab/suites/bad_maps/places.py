"""The good maps: recorded ones, and the project's own worlds."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix_builder.sources.read_map import read_trajectory
from firstfix_builder.sources.read_map.map_file import read_map_file
from tests.recorded_data import GARAGE, HALL, STREET, STREET_128, YARD

from ...worlds import make_world

RECORDED = {one.name: one for one in (HALL, STREET, YARD, STREET_128, GARAGE)}
WORLDS = {
    f"{name}_{seed}": (name, seed) for name in ("office", "factory", "campus", "farm") for seed in (0, 1)
}
NAMES = (*RECORDED, *WORLDS)


@dataclass(frozen=True)
class PlaceMap:
    """A map as a user hands it in.

    Attributes:
        points: (n, 3) of the map's file, in metres.
        poses: (m, 4, 4) T_map_sensor of the mapping run.
        config: of the build.
    """

    points: NDArray[np.float64]
    poses: NDArray[np.float64]
    config: dict[str, Any]


def is_available(name: str) -> bool:
    """Whether the place is here: recordings need not be."""
    return name in WORLDS or RECORDED[name].available


@cache
def place_map(name: str) -> PlaceMap:
    """The right map of a place."""
    if name in WORLDS:
        world_name, seed = WORLDS[name]
        world = make_world(world_name, seed=seed)
        return PlaceMap(world.cloud, world.trajectory, {"sensor": world.sensor.to_mapping()})
    place = RECORDED[name]
    points = read_map_file(place.map_path).points
    with tempfile.TemporaryDirectory() as folder:
        path = place.write_trajectory(Path(folder) / "poses.csv")
        assert points is not None
        assert path is not None
        return PlaceMap(points, read_trajectory(path), place.config)
