import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import InputError, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.query import encode_query
from firstfix.wire.sequence import decode_scans, encode_scans
from tests.every_case import every_case

RNG = np.random.default_rng(0)
SCANS = [Scan(RNG.uniform(-20, 20, (50 + 10 * n, 3)).astype(np.float32), None, 5.0 + n) for n in range(3)]
WAY = [make_transform(rotation_z(0.2 * n), [n, 0.1 * n, 0]) for n in range(3)]
BODY = encode_scans(SCANS, WAY)


def test_what_goes_in_comes_out():
    sequence, expected = decode_scans(BODY), ScanSequence.along(SCANS, WAY)
    assert len(sequence) == 3
    for a, b in zip(sequence.scans, SCANS, strict=True):
        assert np.abs(a.points - b.points).max() <= 0.00501
        assert a.stamp_s == b.stamp_s
    for a, b in zip(sequence.T_last_scan, expected.T_last_scan, strict=True):
        assert np.allclose(a, b, atol=1e-9)


@every_case(
    ("body", "error"),
    [
        (b"", MalformedData),
        (b"FFSC" + BODY[4:], MalformedData),
        (BODY[:4] + b"\x02" + BODY[5:], UnsupportedFormat),
        (BODY[:5] + b"\x00" + BODY[6:], MalformedData),
        (b"FFSS\x01\x00\x00\x00", InvalidScan),
        (BODY[:5] + b"\x11" + BODY[6:], TooLarge),
        (BODY[:5] + b"\x04" + BODY[6:], MalformedData),
        (BODY[:-1], MalformedData),
        (BODY + b"x", MalformedData),
        (BODY[:8] + struct.pack("<7d", 0, 0, 0, 0, 0, 0, 0) + BODY[64:], InvalidScan),
        (BODY[:8] + struct.pack("<7d", np.nan, 0, 0, 0, 0, 0, 1) + BODY[64:], InvalidScan),
        (BODY[:64] + struct.pack("<I", 0xFFFFFFFF) + BODY[68:], MalformedData),
    ],
)
def test_what_is_wrong_is_said(body, error):
    with pytest.raises(error):
        decode_scans(body)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.data())
def test_damaged_bytes_are_an_input_error_or_a_sequence(data):
    body = bytearray(BODY[: data.draw(st.integers(0, len(BODY)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if body:
            body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    with suppress(InputError):
        assert 1 <= len(decode_scans(bytes(body))) <= 16


def test_compact_scans_go_between_whole_ones():
    compact = CompactScan(SCANS[0].points[:40], np.full(16_200, np.inf, np.float32))
    back = decode_scans(encode_scans([SCANS[0], compact], [np.eye(4)] * 2)).scans
    assert [type(scan) for scan in back] == [Scan, CompactScan]
    assert len(back[1]) == 40


def test_a_descriptor_is_no_part_of_a_sequence():
    body = encode_scans([SCANS[0]], [np.eye(4)])
    descriptor = LayeredOccupancy(PolarGrid())
    bits = np.zeros(descriptor.rows * 60 // 8, np.uint8)
    alone = encode_query(ScanDescriptor(descriptor, bits, np.array([0.0, 0, 1]), 1.0))
    length = struct.pack("<I", len(alone))
    with pytest.raises(MalformedData, match="descriptor"):
        decode_scans(body[: 8 + 56] + length + alone)
