"""Sequences of scans in one body, and the packing of numbers into planes and half bytes."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as hnp

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import MalformedData
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.wire.packing import halves_of, joined, packed_halves, planes_of
from firstfix.wire.query import encode_query
from firstfix.wire.sequence import decode_scans, encode_scans
from tests.core.wire.samples import SCANS, SEQUENCE, WAY


def test_a_sequence_comes_back():
    sequence, expected = decode_scans(SEQUENCE), ScanSequence.along(SCANS, WAY)
    assert len(sequence) == 3
    for a, b in zip(sequence.scans, SCANS, strict=True):
        assert np.abs(a.points - b.points).max() <= 0.00501
        assert a.stamp_s == b.stamp_s
    for a, b in zip(sequence.T_last_scan, expected.T_last_scan, strict=True):
        assert np.allclose(a, b, atol=1e-9)


def test_compact_scans_stand_between_whole_ones():
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


lengths = hnp.array_shapes(min_dims=1, max_dims=1, min_side=0, max_side=40)


@given(hnp.arrays(np.dtype("<u4"), lengths))
def test_planes_of_bytes_come_back(some):
    planes = planes_of(some)
    assert planes.shape == (4, len(some))
    np.testing.assert_array_equal(joined(planes, some.dtype), some)
    np.testing.assert_array_equal(joined(planes[:3], some.dtype), some & 0xFFFFFF)


def test_the_least_significant_plane_is_first():
    assert planes_of(np.array([0x0102, 0x0304], "<u2")).tolist() == [[2, 4], [1, 3]]


@given(hnp.arrays(np.uint8, lengths))
def test_half_bytes_come_back(some):
    halves = np.repeat(some & 15, 2)
    np.testing.assert_array_equal(halves_of(np.frombuffer(packed_halves(halves), np.uint8)), halves)


def test_the_first_half_is_the_high_one():
    assert packed_halves(np.array([1, 2, 15, 0], np.uint8)) == b"\x12\xf0"
