"""Unpacking inverts packing, of planes of bytes and of half bytes."""

import numpy as np
from hypothesis import given
from hypothesis.extra import numpy as hnp

from firstfix.wire.packing import halves_of, joined, packed_halves, planes_of

lengths = hnp.array_shapes(min_dims=1, max_dims=1, min_side=0, max_side=40)


@given(hnp.arrays(np.dtype("<u4"), lengths))
def test_planes_come_back(some):
    planes = planes_of(some)
    assert planes.shape == (4, len(some))
    np.testing.assert_array_equal(joined(planes, some.dtype), some)
    np.testing.assert_array_equal(joined(planes[:3], some.dtype), some & 0xFFFFFF)


def test_the_least_significant_plane_is_first():
    assert planes_of(np.array([0x0102, 0x0304], "<u2")).tolist() == [[2, 4], [1, 3]]


@given(hnp.arrays(np.uint8, lengths))
def test_halves_come_back(some):
    halves = np.repeat(some & 15, 2)
    np.testing.assert_array_equal(halves_of(np.frombuffer(packed_halves(halves), np.uint8)), halves)


def test_the_first_half_is_the_high_one():
    assert packed_halves(np.array([1, 2, 15, 0], np.uint8)) == b"\x12\xf0"
