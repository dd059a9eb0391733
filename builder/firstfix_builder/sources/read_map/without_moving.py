"""A map's points without those of moving things, by the scans that the map brings."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.builds.config import CleanConfig
from firstfix.transform import Matrix, transform_points

from .mapping_scans import MappingScans
from .passed_through import Sightings

PLACE_M = 2.0  # one scan of each such cube of the way
FIT_M = 0.3  # median distance of a scan's points from the map's: further, and its pose is wrong
FIT_POINTS = 500


@dataclass(frozen=True)
class Moving:
    """Points that were left out because scans of the mapping run saw through them.

    Attributes:
        scans: number of scans that were looked at.
        left_out: share of the map's points that were left out.
        passed: share that the scans saw through: more than was left out if that was too much.
        not_used: reasons by the names of scans.
    """

    scans: int
    left_out: float
    passed: float
    not_used: dict[str, str]

    def to_mapping(self) -> dict[str, object]:
        """The figures as JSON values."""
        return asdict(self)


def without_moving(
    points: NDArray[np.float64], scans: MappingScans, T_level_map: Matrix, config: CleanConfig
) -> tuple[NDArray[np.bool_], Moving]:
    """Which (n,) of the (n, 3) points of a map no scan of the mapping run saw through.

    Poses that do not fit the map are not used. If more than ``config.most_passed`` would go, nothing goes:
    then it is not things that moved.
    """
    sightings, looked, tree = Sightings.of(points), 0, cKDTree(points, balanced_tree=False)
    not_used: dict[str, str] = {}
    places: set[tuple[int, ...]] = set()
    for name, T_map_sensor in scans.posed():
        T = T_level_map @ T_map_sensor
        place = tuple(np.floor(T[:3, 3] / PLACE_M).astype(int).tolist())
        scan = None if place in places else scans.read(name)
        if scan is None or not len(scan):
            continue
        some = transform_points(T, scan[rows_by_chance(len(scan), FIT_POINTS)].astype(np.float64))
        if np.median(tree.query(some, distance_upper_bound=2 * FIT_M)[0]) > FIT_M:
            not_used[name] = "its pose does not fit the map"
            continue
        places.add(place)
        sightings.look(scan, T)
        looked += 1
    gone = sightings.left(config.passes)
    passed = float(gone.mean())
    if passed > config.most_passed:
        gone[:] = False
    moving = Moving(looked, round(float(gone.mean()), 5), round(passed, 5), {**scans.left_out, **not_used})
    return ~gone, moving
