"""Hint of an ambiguous answer: a move after which the places that look alike look different."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..transform import Matrix, pose_from_mapping, pose_to_mapping


@dataclass(frozen=True)
class Hint:
    """The shortest move that should tell the best hypotheses apart. It is the same under all of them.

    Take the next scan at the goal, and send it together with the scan or scans of this query.

    Attributes:
        T_sensor_goal: (4, 4) pose at which to take the next scan, in the sensor's frame at the query's last
            scan: ``T_odom_goal = T_odom_sensor @ T_sensor_goal``. The way there is level and straight.
        distance_m: length of the way; 0: turn on the spot.
        turn_deg: turn about the vertical at the goal, to the left if positive; 0 for a sensor that sees all
            round.
        separation: 0..1, by how much a scan at the goal is expected to fit the place where it was taken
            better than its best rival.
        tells_apart: numbers of the hypotheses, 0 for the first, that a scan at the goal should tell from all
            others that were compared.
    """

    T_sensor_goal: Matrix
    distance_m: float
    turn_deg: float
    separation: float
    tells_apart: tuple[int, ...]

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        return {
            "T_sensor_goal": pose_to_mapping(self.T_sensor_goal),
            "distance_m": self.distance_m,
            "turn_deg": self.turn_deg,
            "separation": self.separation,
            "tells_apart": list(self.tells_apart),
        }

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Hint:
        """Read what ``to_mapping`` returned. Unknown keys are ignored."""
        return cls(
            pose_from_mapping(data["T_sensor_goal"]),
            float(data["distance_m"]),
            float(data["turn_deg"]),
            float(data["separation"]),
            tuple(int(number) for number in data["tells_apart"]),
        )
