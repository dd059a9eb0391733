"""Turns that a capture cuts at its begin and its end."""

from __future__ import annotations

import numpy as np

from firstfix.formats.point_cloud import PointCloud
from firstfix.recording.whole_turns import whole_turns
from firstfix.ros.header import Header, Stamp
from firstfix.ros.point_cloud2 import StampedCloud
from tests.every_case import every_case


def turn(number: int, first_deg: float, last_deg: float) -> StampedCloud:
    angle = np.radians(np.arange(first_deg, last_deg, 0.5))
    columns = {"x": 5 * np.cos(angle), "y": 5 * np.sin(angle), "z": np.zeros(len(angle))}
    return StampedCloud(Header(Stamp.of_ns(number), "lidar"), PointCloud(columns))


WHOLE = (0, 360)
CASES = {
    "all whole": ([WHOLE] * 3, [0, 1, 2]),
    "cut at both ends": ([(200, 360), WHOLE, WHOLE, (0, 100)], [1, 2]),
    "one alone, which is a part": ([(0, 100)], [0]),
    "a sensor that sees a part": ([(60, 300)] * 3, [0, 1, 2]),
    "two, the second one cut": ([WHOLE, (0, 30)], [0]),
    "a hole in the middle of a drive": ([WHOLE, (0, 100), WHOLE], [0, 1, 2]),
    "none": ([], []),
}


@every_case("name", CASES)
def test_parts_at_the_ends_are_left_out(name: str):
    sectors, kept = CASES[name]
    turns = [turn(number, *one) for number, one in enumerate(sectors)]
    assert [one.header.stamp.ns for one in whole_turns(turns)] == kept
