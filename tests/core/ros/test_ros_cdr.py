"""The field readers and writers, at their edges."""

from __future__ import annotations

import struct

import pytest

from firstfix.errors import MalformedData, UnsupportedFormat
from firstfix.ros.cdr import MAX_TEXT_BYTES, CdrWriter, MessageReader
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


def test_ros1_is_packed():
    read = reader(b"\x07" + struct.pack("<Id", 3, 2.5) + struct.pack("<I", 2) + b"ab", ros1=True)
    assert (read.number("B"), read.number("I"), read.floats(1), read.text()) == (7, 3, (2.5,), "ab")
    read.end()


def test_what_is_written_is_read():
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
def test_more_than_filling_is_one(body, ros1):
    with pytest.raises(MalformedData, match="follow the message"):
        reader(body, ros1=ros1).end()


@every_case("encapsulation", [b"\x00\x02\x00\x00", b"\x00\x07\x00\x00", b"\x01\x00\x00\x00"])
def test_other_encapsulations_are_named(encapsulation):
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
def test_texts_that_are_none(case):
    with pytest.raises(MalformedData, match="Thing"):
        reader(LITTLE + TEXTS[case]).text()


def test_an_empty_text_may_have_no_bytes_at_all():
    assert reader(LITTLE + bytes(4)).text() == ""


def test_a_boolean_is_0_or_1():
    with pytest.raises(MalformedData, match="boolean"):
        reader(LITTLE + b"\x02").flag()


def test_sequences_are_checked_before_they_are_taken():
    with pytest.raises(MalformedData, match="the limit is 10"):
        reader(LITTLE + struct.pack("<I", 11)).count(10, "things")
    with pytest.raises(MalformedData, match="cut off: 0 of 4294967295 bytes"):
        reader(LITTLE + struct.pack("<I", 2**32 - 1)).octets()
