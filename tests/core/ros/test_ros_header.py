"""Stamps stay exact to the nanosecond; frames are names."""

from __future__ import annotations

import pytest

from firstfix.errors import InvalidOption
from firstfix.ros.header import Stamp, check_frame
from tests.every_case import every_case


@every_case(
    ("text", "stamp"),
    [
        ("1700000000.250000001", Stamp(1_700_000_000, 250_000_001)),
        ("1700000000.25", Stamp(1_700_000_000, 250_000_000)),
        ("0", Stamp()),
        ("2147483647.999999999", Stamp(2**31 - 1, 999_999_999)),
    ],
)
def test_a_stamp_is_decimal_seconds(text, stamp):
    assert Stamp.parse(text) == stamp
    assert Stamp.of_ns(stamp.ns) == stamp
    assert Stamp.parse(str(stamp)) == stamp


@every_case("text", ["", "-1", "now", "1e9", "1.0000000001", "2147483648", "9999999999", "inf", "1,5"])
def test_what_ros_cannot_say_is_no_stamp(text):
    with pytest.raises(InvalidOption, match="stamp"):
        Stamp.parse(text)


@every_case("name", ["", "a\nb", "a\0b", "m" * 1024])
def test_what_is_no_frame(name):
    with pytest.raises(InvalidOption, match="frame"):
        check_frame(name)


def test_what_is_one():
    assert check_frame("robot_1/map") == "robot_1/map"
