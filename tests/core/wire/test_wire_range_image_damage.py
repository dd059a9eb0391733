"""Damaged range images are refused with an error."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.errors import FirstfixError, MalformedData, TooLarge
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.wire.scan import decode_scan
from tests.core.wire.range_images import body_of, image_of, spinning
from tests.every_case import every_case

HEADER_BYTES = 36


@every_case(
    "body",
    [
        body_of(8, 4, [0, 0, 15, 14], [15], [16, 2, 255, 255], [800, 801]),  # cell 32
        body_of(8, 4, [0, 0, 15], [2**24 - 1], [16, 2, 2], []),
        body_of(8, 4, [0, 0, 0, 5], [], [16, 2, 2], []),  # half a byte too many
        body_of(8, 4, [0, 0], [], [16, 31], []),  # back to a range of zero
        body_of(8, 4, [0, 15], [], [16, 2], []),
        body_of(8, 4, [0, 0], [3], [16, 2], []),
        body_of(8, 4, [0, 0], [], [16, 255], []),
        body_of(8, 4, [0, 0], [], [16, 2], [300]),
        body_of(3, 4, [0], [], [2], []),
        body_of(8, 1, [0], [], [2], []),
        body_of(4097, 4096, [0], [], [2], []),
    ],
)
def test_what_contradicts_itself_is_malformed(body):
    with pytest.raises(MalformedData):
        decode_scan(body)


@every_case(
    ("offset", "form", "value", "error"),
    [
        (6, "H", 2, MalformedData),
        (8, "I", 1, MalformedData),
        (8, "I", MAX_POINTS + 1, TooLarge),
        (8, "I", 2**32 - 1, TooLarge),
        (12, "H", 0, MalformedData),
        (12, "H", 65_535, MalformedData),
        (14, "H", 1, MalformedData),
        (16, "d", 0.0, MalformedData),
        (16, "d", float("nan"), MalformedData),
        (24, "d", float("inf"), MalformedData),
        (32, "I", 0, MalformedData),
        (32, "I", 2**32 - 1, MalformedData),
    ],
)
def test_each_header_field_is_checked(offset, form, value, error):
    body = bytearray(image_of(spinning()))
    struct.pack_into("<" + form, body, offset, value)
    with pytest.raises(error):
        decode_scan(bytes(body))


def test_coordinates_out_of_range_are_malformed():
    body = bytearray(image_of(Scan.from_points([[100, 0, 0]])))
    struct.pack_into("<d", body, 16, 0.5)  # 4000 steps of half a metre
    with pytest.raises(MalformedData, match="beyond"):
        decode_scan(bytes(body))


def test_every_truncation_is_malformed():
    body = image_of(spinning(20))
    for length in range(len(body)):
        with pytest.raises(MalformedData):
            decode_scan(body[:length])
    with pytest.raises(MalformedData):
        decode_scan(body + b"\0")


def test_every_bit_flip_of_the_frames_is_found():
    body = image_of(spinning(8))
    points = decode_scan(body).points
    for position in range(HEADER_BYTES, len(body)):
        for bit in range(8):
            damaged = bytearray(body)
            damaged[position] ^= 1 << bit
            try:
                back = decode_scan(bytes(damaged))
            except FirstfixError:
                continue
            # zstd has bits without meaning (its reserved ones are ignored): the points must be the same
            np.testing.assert_array_equal(back.points, points)


@given(st.data())
@settings(max_examples=400, deadline=None)
def test_damage_gives_an_error_or_a_sane_scan(data):
    """Damages the header and the content of the frames."""
    body = image_of(spinning(20))
    length = struct.unpack_from("<I", body, 32)[0]
    contents = [zstandard.decompress(frame) for frame in (body[36 : 36 + length], body[36 + length :])]
    parts = [bytearray(body[:HEADER_BYTES]), *map(bytearray, contents)]
    for _ in range(data.draw(st.integers(1, 4))):
        part = parts[data.draw(st.integers(0, 2))]
        part[data.draw(st.integers(6 if part is parts[0] else 0, len(part) - 1))] = data.draw(
            st.integers(0, 255)
        )
    gaps, ranges = (zstandard.compress(bytes(part)) for part in parts[1:])
    struct.pack_into("<I", parts[0], 32, len(gaps))
    try:
        scan = decode_scan(bytes(parts[0]) + gaps + ranges)
    except FirstfixError:
        return
    assert np.isfinite(scan.points).all()
    assert len(scan) == struct.unpack_from("<I", parts[0], 8)[0]


@every_case("frame", [0, 1])
@every_case("declared", [True, False])
def test_a_bomb_is_refused_before_its_memory_is_taken(frame, declared):
    body = image_of(spinning(20))
    end = HEADER_BYTES + struct.unpack_from("<I", body, 32)[0]
    frames = [body[HEADER_BYTES:end], body[end:]]
    frames[frame] = zstandard.ZstdCompressor(write_content_size=declared).compress(bytes(300_000_000))
    head = body[:32] + struct.pack("<I", len(frames[0]))
    tracemalloc.start()
    try:
        with pytest.raises(MalformedData):
            decode_scan(head + frames[0] + frames[1])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


def test_as_many_returns_as_there_may_be_take_bounded_memory():
    count = MAX_POINTS
    gaps = zstandard.compress(bytes(count // 2))
    ranges = zstandard.compress(bytes([8]) + bytes(count - 1))
    head = struct.pack("<4sBBHIHHddI", b"FFSC", 1, 2, 4096, count, 4096, 0, 0.5, 0.0, len(gaps))
    tracemalloc.start()
    try:
        assert len(decode_scan(head + gaps + ranges)) == count
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100 * count
