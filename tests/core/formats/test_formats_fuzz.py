"""Damaged bodies: the result is a scan or an InputError, in little memory."""

from __future__ import annotations

import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.decode import decode_query
from firstfix.errors import InputError
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.formats.text import decode_text
from firstfix.scan.scan import Scan
from tests.core.formats.cloud_files import pcd, ply, random_cloud, text_rows
from tests.every_case import every_case
from tests.ros_samples import cdr, cloud

pytestmark = pytest.mark.slow

CLOUD = random_cloud(12)
BODIES = {
    "pcd ascii": (pcd(CLOUD, "ascii"), "application/x-pcd"),
    "pcd binary": (pcd(CLOUD, "binary"), "application/x-pcd"),
    "pcd compressed": (pcd(CLOUD, "binary_compressed"), "application/x-pcd"),
    "ply ascii": (ply(CLOUD, "ascii"), "application/ply"),
    "ply little": (ply(CLOUD, "binary_little_endian"), "application/ply"),
    "ply big": (ply(CLOUD, "binary_big_endian"), "application/ply"),
    "xyz": (np.zeros((12, 3), "<f4").tobytes(), "application/vnd.firstfix.xyz"),
    "cdr": (cdr(cloud(CLOUD)), "application/vnd.ros2.cdr"),
    "cdr big": (cdr(cloud(CLOUD), little_endian=False), "application/cdr"),
    "xyzi": (np.zeros((12, 4), "<f4").tobytes(), "application/vnd.firstfix.xyzi"),
}
SPECIAL_WORDS = [
    b"-1",
    b"0",
    b"99999999999999999999",
    b"1e308",
    b"nan",
    b"inf",
    b"list",
    b"\0",
    b"\xff",
    b"\n",
]


def decode_or_refuse(body: bytes, media_type: str) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scan = decode_query(body, media_type)
    except InputError:
        return
    assert isinstance(scan, Scan)
    assert np.isfinite(scan.points).all()


@every_case("name", BODIES)
def test_the_bodies_are_good_before_they_are_damaged(name):
    assert len(decode_query(*BODIES[name])) == 12


@every_case("name", BODIES)
def test_cut_off_anywhere(name):
    body, media_type = BODIES[name]
    for end in range(len(body)):
        decode_or_refuse(body[:end], media_type)


@pytest.mark.parametrize("name", BODIES)
@given(data=st.data())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_damaged_anywhere(name, data):
    body, media_type = BODIES[name]
    damaged = bytearray(body)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(damaged) - 1))
        kind = data.draw(st.sampled_from(["flip", "insert", "remove", "word"]))
        if kind == "flip":
            damaged[place] ^= data.draw(st.integers(1, 255))
        elif kind == "insert":
            damaged[place:place] = data.draw(st.binary(min_size=1, max_size=20))
        elif kind == "remove":
            del damaged[place : place + data.draw(st.integers(1, min(30, len(damaged) - 1)))]
            damaged = damaged or bytearray(b"x")
        else:
            damaged[place : place + 2] = data.draw(st.sampled_from(SPECIAL_WORDS))
    tracemalloc.start()
    decode_or_refuse(bytes(damaged), media_type)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2_000_000


@pytest.mark.parametrize("media_type", sorted({media_type for _, media_type in BODIES.values()}))
@given(body=st.binary(max_size=300))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_any_bytes(media_type, body):
    decode_or_refuse(body, media_type)


@given(
    body=st.binary(max_size=200), glue=st.sampled_from([b"", b"x,y,z\n", b"1 2 3\n", b"5\n", b"# x y z\n"])
)
@settings(max_examples=300, deadline=None, derandomize=True)
def test_any_text(glue, body):
    for text in (glue + body, text_rows(CLOUD) + body):
        try:
            decode_text(text, SCAN_LIMITS)
        except InputError:
            continue


@given(body=st.binary(max_size=400), name=st.sampled_from(["a.bin", "a.velodyne_sync.bin"]))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_any_bin(body, name):
    try:
        decode_scanner_bin(body, name, SCAN_LIMITS)
    except InputError:
        return
