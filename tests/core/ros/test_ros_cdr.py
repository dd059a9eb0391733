"""Fields of messages, their stamps and frames: at their edges."""

from __future__ import annotations

import struct

import pytest

from firstfix.errors import InvalidOption, MalformedData, UnsupportedFormat
from firstfix.ros.cdr import MAX_TEXT_BYTES, CdrWriter, MessageReader
from firstfix.ros.header import Stamp, check_frame
from tests.every_case import every_case

LITTLE, BIG = b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"


def reader(body: bytes, **options: bool) -> MessageReader:
    return MessageReader("Thing", body, **options)


@every_case(("encapsulation", "order"), [(LITTLE, "<"), (BIG, ">")])
def test_numbers_are_aligned_to_their_size_after_the_encapsulation(encapsulation, order):
    body = encapsulation + b"\x07\0\0\0" + struct.pack(f"{order}iI", -5, 3) + b"\0\0\0\0"
    body += struct.pack(f"{order}2d", 2.5, -1.0)
    read = reader(body)
    assert (read.number("B"), read.number("i"), read.number("I")) == (7, -5, 3)
    assert read.floats(2) == (2.5, -1.0)
    read.end()


def test_a_written_message_is_read():
    writer = CdrWriter()
    writer.numbers("B", [1])
    writer.text("wände")
    writer.numbers("d", [0.1, -2e300])
    read = reader(writer.bytes())
    assert read.flag()
    assert read.text() == "wände"
    assert read.floats(2) == (0.1, -2e300)
    read.end()


@every_case("filling", [0, 1, 2, 3])
def test_filling_up_to_four_bytes_is_no_error(filling):
    reader(LITTLE + bytes(filling)).end()


@every_case(("body", "ros1"), [(LITTLE + bytes(4), False), (b"\0", True)])
def test_more_than_filling_is_malformed(body, ros1):
    with pytest.raises(MalformedData, match="follow the message"):
        reader(body, ros1=ros1).end()


@every_case("encapsulation", [b"\x00\x02\x00\x00", b"\x00\x07\x00\x00", b"\x01\x00\x00\x00"])
def test_other_encapsulations_are_unsupported(encapsulation):
    with pytest.raises(UnsupportedFormat, match=encapsulation[:2].hex()):
        reader(encapsulation)


TEXTS = {
    "longer than the body": struct.pack("<I", 900) + b"abc\0",
    "longer than any name": struct.pack("<I", MAX_TEXT_BYTES + 1) + bytes(MAX_TEXT_BYTES + 1),
    "without its zero byte": struct.pack("<I", 3) + b"abc",
    "not UTF-8": struct.pack("<I", 3) + b"\xff\xfe\0",
    "cut off in its length": b"\x01\0",
}


@every_case("case", TEXTS)
def test_invalid_texts_are_malformed(case):
    with pytest.raises(MalformedData, match="Thing"):
        reader(LITTLE + TEXTS[case]).text()


def test_ros1_is_packed():
    read = reader(b"\x07" + struct.pack("<Id", 3, 2.5) + struct.pack("<I", 2) + b"ab", ros1=True)
    assert (read.number("B"), read.number("I"), read.floats(1), read.text()) == (7, 3, (2.5,), "ab")
    read.end()
    assert reader(LITTLE + bytes(4)).text() == "", "which may have no bytes at all"


@every_case(
    ("read", "body", "says"),
    [
        (lambda one: one.flag(), b"\x02", "boolean"),
        (lambda one: one.count(10, "things"), struct.pack("<I", 11), "the limit is 10"),
        (lambda one: one.octets(), struct.pack("<I", 2**32 - 1), "cut off: 0 of 4294967295 bytes"),
    ],
)
def test_invalid_booleans_and_sequences_are_malformed(read, body, says):
    with pytest.raises(MalformedData, match=says):
        read(reader(LITTLE + body))


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
def test_an_invalid_stamp_is_refused(text):
    with pytest.raises(InvalidOption, match="stamp"):
        Stamp.parse(text)


@every_case("name", ["", "a\nb", "a\0b", "m" * 1024])
def test_an_invalid_frame_is_refused(name):
    with pytest.raises(InvalidOption, match="frame"):
        check_frame(name)
    assert check_frame("robot_1/map") == "robot_1/map"
