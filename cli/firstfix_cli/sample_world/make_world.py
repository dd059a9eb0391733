"""A sample world from its name and a seed: the same arrays, byte for byte, every time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator

from .drive import drive
from .factory import factory
from .place import Place
from .query import WorldQuery, foreign_scan, queries
from .survey import survey

Layout = Callable[[np.random.Generator], Place]
SAMPLE: dict[str, Layout] = {"factory": factory}
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


def make_world(name: str, *, seed: int = 0, layouts: Mapping[str, Layout] = SAMPLE) -> World:
    """Lay a place out, drives through it, and comes back when things have moved.

    Args:
        name: a key of ``layouts``.
        seed: another seed gives another place of the same kind.
        layouts: kinds of places. Their order decides the chance of each; the last scans are of two other
            places of the kind, and of the first two other kinds.

    Raises:
        InvalidOption: no such world, or a negative seed.
    """
    if name not in layouts:
        raise InvalidOption(f"no world {name!r}; there are {', '.join(layouts)}")
    if seed < 0:
        raise InvalidOption(f"a seed is 0 or more, not {seed}")
    place = place_of(name, seed, layouts)
    mesh, path = place.mesh(), drive(place)
    rng = np.random.default_rng([seed, _number(name, layouts), 1])
    mapped = survey(Simulator(mesh.vertices, mesh.triangles), place.sensor, path, place.voxel_m, rng)
    found = queries(place, mapped, QUERIES, rng)
    others = [other for other in layouts if other != name][:2]
    alike = [(name, seed + number * OTHER_SEED) for number in (1, 2)]
    for other_name, other_seed in [*alike, *((other, seed) for other in others)]:
        other = place_of(other_name, other_seed, layouts)
        found.append(foreign_scan(other, drive(other), place.sensor, rng))
    return World(name, seed, mesh, place.sensor, mapped.T_map_sensor, mapped.cloud, found)


def place_of(name: str, seed: int, layouts: Mapping[str, Layout] = SAMPLE) -> Place:
    """A place of a kind, before anything is measured in it."""
    return layouts[name](np.random.default_rng([seed, _number(name, layouts), 0]))


def _number(name: str, layouts: Mapping[str, Layout]) -> int:
    return list(layouts).index(name)
