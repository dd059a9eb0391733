"""The cases: each a place, and what was done to its map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.transform import rotation_z

from .lying import (
    at_heights,
    leaning,
    of_one_scan,
    rounded,
    sunk,
    without_ground,
    without_poses,
    written_with,
)
from .places import NAMES, PlaceMap

Change = Callable[[PlaceMap], PlaceMap]
GOOD = "good"


@dataclass(frozen=True)
class MapCase:
    """One map.

    Attributes:
        fault: GOOD, or what is wrong.
        place: name of the place of which it is made.
        told: how it was made, in words.
        change: makes it of the right map.
        is_seen_by_builds: the fault shows in the self-test alone: the check of the map cannot find it.
        config: put over the build's config.
        code: of the finding that names the fault; empty: any will do.
    """

    fault: str
    place: str
    told: str
    change: Change
    is_seen_by_builds: bool = False
    config: dict[str, Any] | None = None
    code: str = ""

    @property
    def name(self) -> str:
        return f"{self.fault}, {self.place}: {self.told}"


def cases() -> list[MapCase]:
    """All cases: each place as it is, and the bad maps."""
    return [
        *(MapCase(GOOD, place, "as it is", unchanged) for place in NAMES),
        *(
            MapCase("doubled", place, told, doubled(*by))
            for place, by, told in (
                ("hall", (1.5, 0.4, False), "a copy turned by 1.5 degrees, 0.4 m away"),
                ("hall", (0.5, 0.5, True), "half of it again, by 0.5 degrees and 0.5 m"),
                ("yard", (1.5, 0.4, False), "a copy turned by 1.5 degrees, 0.4 m away"),
                ("street", (0.2, 0.5, False), "a copy turned by 0.2 degrees, 0.5 m away"),
                ("street_128beam", (0.0, 0.3, False), "a copy 0.3 m away"),
                ("street_128beam", (0.5, 0.5, True), "half of it again, by 0.5 degrees and 0.5 m"),
                ("office_0", (0.0, 0.35, False), "a copy 0.35 m away"),
                ("factory_0", (1.5, 0.4, False), "a copy turned by 1.5 degrees, 0.4 m away"),
                ("campus_0", (0.8, 0.45, True), "half of it again, by 0.8 degrees and 0.45 m"),
            )
        ),
        *(
            MapCase(
                "turned trajectory", place, f"by {turn_deg} degrees about {about}", turned(turn_deg, about)
            )
            for place, turn_deg, about in (
                ("hall", 90, "its middle"),
                ("hall", 90, "the origin"),
                ("street", 90, "its middle"),
                ("street", 180, "its middle"),
                ("yard", 270, "its middle"),
                ("yard", 180, "its middle"),
                ("street_128beam", 90, "its middle"),
                ("garage", 180, "its middle"),
                ("office_0", 90, "its middle"),
                ("office_1", 180, "its middle"),
                ("factory_0", 45, "its middle"),
                ("factory_1", 90, "the origin"),
                ("campus_0", 180, "its middle"),
                ("farm_0", 90, "its middle"),
            )
        ),
        *(
            MapCase("turned trajectory", place, "x and y exchanged", exchanged)
            for place in ("yard", "factory_0", "campus_1")
        ),
        *(MapCase("y up", place, "(x, y, z) -> (y, z, x)", y_up) for place in ("hall", "office_0", "yard")),
        *(
            MapCase("wrong unit", place, f"times {factor:g}", scaled(factor))
            for place, factor in (("hall", 1000), ("hall", 0.001), ("factory_0", 1000), ("street", 0.001))
        ),
        *lying_maps(),
        MapCase("too few points", "hall", "1 in 4,000", thinned(4000), is_seen_by_builds=True),
        MapCase("too few points", "office_0", "1 in 4,000", thinned(4000), is_seen_by_builds=True),
        MapCase(
            "asked nothing",
            "office_0",
            "a sensor in the floor",
            unchanged,
            is_seen_by_builds=True,
            config={"viewpoints": {"mount_height_m": 0.05}},
        ),
    ]


def lying_maps() -> list[MapCase]:
    """Good maps without their poses, and those whose map or poses are not what they seem."""
    return [
        *(MapCase(GOOD, place, "without its poses", without_poses) for place in NAMES),
        *(
            MapCase(
                "doubled floors",
                place,
                f"the way back sinks by {by_m} m{told}",
                change,
                code="map_doubled_floors",
            )
            for place, by_m in (
                ("hall", 0.6),
                ("street_128beam", 0.4),
                ("office_0", 0.35),
                ("factory_1", 0.6),
                ("campus_0", 0.5),
                ("yard", 0.3),
                ("farm_1", 0.6),
            )
            for told, change in (("", sunk(by_m)), (", without poses", sunk(by_m, keeps_poses=False)))
            if not told or by_m >= 0.5
        ),
        *(
            MapCase(
                "leaning",
                place,
                f"by {lean_deg} degrees",
                leaning(lean_deg, direction_deg),
                code="trajectory_leans",
            )
            for place, lean_deg, direction_deg in (
                ("hall", 10, 40),
                ("street", 3, 200),
                ("yard", 5, 90),
                ("office_1", 10, 300),
                ("factory_0", 4, 10),
                ("farm_0", 8, 120),
                ("campus_1", 2, 250),
                ("street_128beam", 6, 160),
            )
        ),
        *(
            MapCase(
                "base's poses",
                place,
                f"{over_m:+.2f} m over the floor",
                at_heights(sensor_m, over_m),
                code=code,
            )
            for place, sensor_m, over_m, code in (
                ("hall", 1.75, 0.0, "trajectory_of_base"),
                ("street", 1.73, 0.0, "trajectory_of_base"),
                ("yard", 0.63, -0.05, "trajectory_of_base"),
                ("office_0", 1.0, 0.0, "trajectory_of_base"),
                ("factory_1", 1.0, -0.05, "trajectory_of_base"),
                ("campus_0", 1.0, 0.1, "trajectory_at_floor"),
                ("farm_0", 0.6, 0.0, "trajectory_of_base"),
                ("garage", 1.36, 0.0, "trajectory_of_base"),
            )
        ),
        *(
            MapCase(
                "no ground",
                place,
                f"all up to {over_m} m over it left out{told}",
                change,
                code="map_no_ground",
            )
            for place, sensor_m, over_m in (
                ("hall", 1.75, 0.3),
                ("yard", 0.63, 0.2),
                ("factory_0", 1.0, 0.15),
                ("campus_1", 1.0, 0.3),
                ("garage", 1.36, 0.15),
                ("street", 1.73, 0.3),
            )
            for told, change in (
                ("", without_ground(sensor_m, over_m)),
                (", without poses", without_ground(sensor_m, over_m, keeps_poses=False)),
            )
            if not told or place in ("hall", "factory_0", "garage")
        ),
        *(
            MapCase(
                "few digits",
                place,
                f"{digits} digits, {far_m:,} m away",
                written_with(digits, far_m),
                code=code,
            )
            for place, digits, far_m, code in (
                ("hall", 6, 42_300, "map_digits_few"),
                ("street", 6, 450_000, "map_digits_lost"),
                ("office_0", 6, 30_000, "map_digits_few"),
                ("campus_1", 5, 42_300, "map_digits_lost"),
            )
        ),
        *(
            MapCase("few digits", place, f"a scale of {step_m} m", rounded(step_m), code=code)
            for place, step_m, code in (
                ("hall", 0.1, "map_digits_few"),
                ("yard", 0.25, "map_digits_lost"),
                ("factory_0", 0.1, "map_digits_few"),
            )
        ),
        *(
            MapCase("single scan", place, told, of_one_scan(number, moved), code="map_single_scan")
            for place, number, moved, told in (
                ("hall", 0, False, "its first query"),
                ("hall", 4, True, "a query, moved and turned"),
                ("street", 3, False, "a query"),
                ("street_128beam", 1, True, "a query, moved and turned"),
                ("street", 8, True, "a query, moved and turned"),
                ("yard", 5, False, "a query"),
                ("yard", 9, True, "a query, moved and turned"),
            )
        ),
    ]


def unchanged(right: PlaceMap) -> PlaceMap:
    """The map as it is."""
    return right


def doubled(turn_deg: float, away_m: float, of_half: bool) -> Change:
    """The map, and it or the half of larger x again: a loop that was not closed."""

    def change(right: PlaceMap) -> PlaceMap:
        middle = np.median(right.points, axis=0)
        again = right.points[right.points[:, 0] > middle[0]] if of_half else right.points
        shift_m = away_m * np.array([0.8, 0.6, 0.0])
        copy = (again - middle) @ rotation_z(np.radians(turn_deg)).T + middle + shift_m
        return replace(right, points=np.concatenate([right.points, copy]))

    return change


def turned(turn_deg: float, about: str) -> Change:
    """The trajectory turned about the middle of its way, or about the map's origin."""

    def change(right: PlaceMap) -> PlaceMap:
        centre = right.poses[:, :3, 3].mean(axis=0) if about == "its middle" else np.zeros(3)
        return replace(right, poses=_moved(right.poses, rotation_z(np.radians(turn_deg)), centre))

    return change


def exchanged(right: PlaceMap) -> PlaceMap:
    """The positions with x and y exchanged."""
    poses = right.poses.copy()
    poses[:, :2, 3] = poses[:, 1::-1, 3]
    return replace(right, poses=poses)


def y_up(right: PlaceMap) -> PlaceMap:
    """Map and trajectory with y up, as SLAM in a camera's frame leaves them."""
    R = np.eye(3)[[1, 2, 0]]
    return replace(right, points=right.points @ R.T, poses=_moved(right.poses, R, np.zeros(3)))


def scaled(factor: float) -> Change:
    """Map and trajectory in another unit."""

    def change(right: PlaceMap) -> PlaceMap:
        poses = right.poses.copy()
        poses[:, :3, 3] *= factor
        return replace(right, points=factor * right.points, poses=poses)

    return change


def thinned(step: int) -> Change:
    """One point in so many."""

    def change(right: PlaceMap) -> PlaceMap:
        return replace(
            right, points=right.points[rows_by_chance(len(right.points), len(right.points) // step)]
        )

    return change


def _moved(
    poses: NDArray[np.float64], R: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    moved = poses.copy()
    moved[:, :3, :3] = R @ poses[:, :3, :3]
    moved[:, :3, 3] = (poses[:, :3, 3] - centre) @ R.T + centre
    return moved
