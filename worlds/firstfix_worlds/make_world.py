"""A sample world from its name and a seed: the same arrays, byte for byte, every time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator

from .campus import campus
from .drive import drive
from .factory import factory
from .farm import farm
from .office import office
from .place import Place
from .query import WorldQuery, foreign_scan, queries
from .survey import survey

_PLACES = {"factory": factory, "office": office, "campus": campus, "farm": farm}
NAMES = tuple(_PLACES)
QUERIES = 26
OTHER_SEED = 7919  # added to the seed for the places that are not in the map


@dataclass(frozen=True)
class World:
    """A simulated world with its map and queries.

    Attributes:
        name, seed: what it was made from.
        mesh: the true surfaces at the time of mapping.
        sensor: the robot's LiDAR, for mapping and for queries.
        trajectory: (m, 4, 4) T_map_sensor of the mapping drive, as its SLAM estimated it.
        cloud: (n, 3) float64 map, in the frame of the trajectory.
        queries: scans taken later, at poses that were not driven; the last ones are of other places.
    """

    name: str
    seed: int
    mesh: Mesh
    sensor: SensorModel
    trajectory: NDArray[np.float64]
    cloud: NDArray[np.float64]
    queries: list[WorldQuery]


def make_world(name: str, *, seed: int = 0) -> World:
    """Lays a place out, drives through it, and comes back when things have moved.

    Args:
        name: one of NAMES.
        seed: another seed gives another place of the same kind.

    Raises:
        InvalidOption: no such world, or a negative seed.
    """
    if name not in _PLACES:
        raise InvalidOption(f"no world {name!r}; there are {', '.join(NAMES)}")
    if seed < 0:
        raise InvalidOption(f"a seed is 0 or more, not {seed}")
    place = _place(name, seed)
    mesh, path = place.mesh(), drive(place)
    rng = np.random.default_rng([seed, NAMES.index(name), 1])
    mapped = survey(Simulator(mesh.vertices, mesh.triangles), place.sensor, path, place.voxel_m, rng)
    found = queries(place, mapped, QUERIES, rng)
    for other_name, other_seed in _elsewhere(name, seed):
        other = _place(other_name, other_seed)
        found.append(foreign_scan(other, drive(other), place.sensor, rng))
    return World(name, seed, mesh, place.sensor, mapped.T_map_sensor, mapped.cloud, found)


def _place(name: str, seed: int) -> Place:
    return _PLACES[name](np.random.default_rng([seed, NAMES.index(name), 0]))


def _elsewhere(name: str, seed: int) -> list[tuple[str, int]]:
    """Worlds of the scans outside the map: two of the same kind, two of others."""
    others = [other for other in NAMES if other != name][:2]
    return [(name, seed + OTHER_SEED), (name, seed + 2 * OTHER_SEED), *((other, seed) for other in others)]
