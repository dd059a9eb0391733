"""Every count in a LAS or LAZ file is compared with the file's size before a library believes it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge
from firstfix.formats.las import read_las
from firstfix.formats.laz_chunks import check_las
from firstfix.formats.point_cloud import MAP_LIMITS, Limits

POINTS = 300


@pytest.fixture(params=["a.las", "a.laz"])
def cloud(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    return written(tmp_path / request.param)


def written(path: Path, point_format: int = 6, points: int = POINTS) -> Path:
    las = laspy.create(point_format=point_format, file_version="1.4")
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = np.random.default_rng(0).uniform(-20, 20, (3, points))
    las.header.vlrs.append(laspy.VLR("firstfix", 7, "a note", bytes(40)))
    las.write(path)
    return path


def patched(path: Path, at: int, value: bytes) -> Path:
    raw = bytearray(path.read_bytes())
    raw[at : at + len(value)] = value
    path.write_bytes(raw)
    return path


def record_of(path: Path, user: bytes) -> int:
    """Place of the content of a record before the points."""
    return path.read_bytes().index(user) - 2 + 54


def read(path: Path) -> int:
    check_las(path, MAP_LIMITS, 32)
    return len(read_las(path, MAP_LIMITS))


def points_start(path: Path) -> int:
    return int(struct.unpack_from("<I", path.read_bytes(), 96)[0])


def chunk_table(path: Path) -> int:
    return int(struct.unpack_from("<q", path.read_bytes(), points_start(path))[0])


@pytest.mark.parametrize(
    ("at", "value", "says"),
    [
        (100, b"\xff" * 4, "cannot hold 4294967295 variable length records"),
        (96, struct.pack("<I", 2**31), "cut off"),
    ],
)
def test_counts_beyond_the_file_are_malformed(cloud: Path, at: int, value: bytes, says: str):
    with pytest.raises(MalformedData, match=says):
        read(patched(cloud, at, value))


def compression(path: Path) -> int:
    return record_of(path, b"laszip encoded")


@pytest.mark.parametrize(
    ("place", "offset", "value", "says"),
    [
        (compression, 0, struct.pack("<H", 9), None),  # compressor
        (compression, 12, struct.pack("<I", 0), None),  # points a chunk
        (compression, 12, struct.pack("<I", 100), None),  # three chunks, and there is one
        (compression, 12, struct.pack("<I", 0xFFFFFFFF), None),  # the table has no numbers of points
        (compression, 32, struct.pack("<H", 0xFFFF), None),  # items
        (compression, 36, struct.pack("<H", 0xFFFF), None),  # bytes of the first item
        (compression, 38, struct.pack("<H", 2), None),  # version of the first item
        *((chunk_table, 4, struct.pack("<I", count), "chunks") for count in (0, 2, 0xFFFFFFFF)),
        *((points_start, 0, struct.pack("<q", place), "table") for place in (-1, 0, 2**40, 2**63 - 1)),
        *((points_start, 42 + 4 * layer, b"\xf0\xff\xff\xff", "layers of chunk 0") for layer in range(9)),
        (
            lambda path: 247,
            0,
            struct.pack("<Q", 299_000_000),
            "compressed bytes cannot hold 299000000 points",
        ),
    ],
)
def test_a_compression_that_contradicts_the_file_is_malformed(tmp_path: Path, place, offset, value, says):
    path = written(tmp_path / "a.laz")
    with pytest.raises(MalformedData, match=says):
        read(patched(path, place(path) + offset, value))


def test_a_record_that_reaches_into_the_points_is_malformed(cloud: Path):
    place = record_of(cloud, b"firstfix") - 54 + 20
    with pytest.raises(MalformedData, match="reaches into the points"):
        read(patched(cloud, place, b"\xff\xff"))


def test_extended_records_are_not_read(cloud: Path):
    assert read(patched(cloud, 235, struct.pack("<QI", 2**62, 0xFFFFFFFF))) == POINTS


@pytest.mark.parametrize("points", [POINTS + 1, 299_000_000])
def test_more_points_than_bytes_are_malformed(tmp_path: Path, points: int):
    with pytest.raises(MalformedData, match="cut off"):
        read(patched(written(tmp_path / "a.las"), 247, struct.pack("<Q", points)))


def test_more_points_than_the_limits_are_refused(cloud: Path):
    with pytest.raises(TooLarge):
        read(patched(cloud, 247, struct.pack("<Q", 2**40)))
    with pytest.raises(TooLarge):
        read_las(cloud, Limits(max_points=10, max_decoded_bytes=10**9))


def test_a_truncated_chunk_table_is_malformed(tmp_path: Path):
    path = written(tmp_path / "a.laz")
    path.write_bytes(path.read_bytes()[: chunk_table(path) + 9])
    with pytest.raises(MalformedData, match="LAS"):
        read(path)


@pytest.mark.parametrize("point_format", [0, 1, 3, 6, 7, 8])
def test_every_point_format_is_read(tmp_path: Path, point_format: int):
    for points in (1, 49_999, 50_000, 50_001, 150_000):
        assert read(written(tmp_path / "a.laz", point_format, points)) == points
    assert read(written(tmp_path / "a.las", point_format, 1000)) == 1000


def test_a_file_without_points_is_read(cloud: Path):
    assert read(written(cloud, points=0)) == 0
