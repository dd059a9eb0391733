"""The cases: each a place, and what was done to its map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.transform import rotation_z

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
    """

    fault: str
    place: str
    told: str
    change: Change
    is_seen_by_builds: bool = False
    config: dict[str, Any] | None = None

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
