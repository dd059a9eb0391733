"""CompressedPointCloud2 of zstd, zlib and Draco."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import DracoPy
import numpy as np
import pytest
import zstandard

from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.recording.compressed_cloud import decode_compressed_cloud
from firstfix.recording.confined_process import ConfinedProcess
from firstfix.recording.messages import CDR, ROS1, RawMessage
from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import StampedCloud, decode_point_cloud2
from tests.every_case import every_case
from tests.lidar_messages import STORES, compressed, raw
from tests.ros_samples import cloud, write_bag

COUNT = 500
FIELDS = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4"), ("ring", "<u2")]
POINTS = np.zeros(COUNT, FIELDS)
for _number, (_name, _) in enumerate(FIELDS):
    POINTS[_name] = np.random.default_rng(_number).uniform(0, 60, COUNT)
POINTS["t"] = np.linspace(0, 99_000_000, COUNT)
PACK = {"zstd": zstandard.compress, "zlib": zlib.compress}


PROCESS = ConfinedProcess()


@pytest.fixture(scope="module", autouse=True)
def process() -> Iterator[None]:
    yield
    PROCESS.close()


def decode(message: object, encoding: str = CDR, limits: Limits = SCAN_LIMITS) -> StampedCloud:
    return decode_compressed_cloud(PROCESS, raw(message, encoding), limits)


@every_case("form, encoding, padding", [(f, e, p) for f in PACK for e in (CDR, ROS1) for p in (0, 5)])
def test_a_packed_cloud_is_the_plain_one(form: str, encoding: str, padding: int):
    """Rows with padding put the length of the data at every place of the alignment."""
    plain = cloud(POINTS.reshape(20, 25), stores=STORES[encoding], row_padding=padding)
    packed = compressed(plain, form, PACK[form](plain.data.tobytes()), encoding)
    expected = decode_point_cloud2(raw(plain, encoding).body, SCAN_LIMITS, ros1=encoding == ROS1)
    got = decode(packed, encoding)
    assert got.header == expected.header
    assert got.cloud.columns.keys() == expected.cloud.columns.keys()
    for name, column in expected.cloud.columns.items():
        np.testing.assert_array_equal(got.cloud.columns[name], column)


def draco(points: np.ndarray) -> bytes:
    """Packs points as draco_point_cloud_transport does: an attribute of one component for each field.

    The layout is that of Draco 2.3's sequential encoder without prediction, as DracoPy writes it (next test).
    """
    codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 9, "f8": 10}
    names = points.dtype.names or ()
    head = b"DRACO" + struct.pack("<BBBBHiBB", 2, 3, 0, 0, 0, len(points), 1, len(names))
    for number, name in enumerate(names):
        head += bytes([0 if name in "xyz" else 4, codes[points[name].dtype.str[1:]], 1, 0, number])
    return head + bytes(len(names)) + b"".join(points[name].tobytes() for name in names)


def test_our_writer_of_draco_is_draco():
    """DracoPy's encoder gives the same bytes where it can: three components, one attribute."""
    xyz = np.stack([POINTS[axis] for axis in "xyz"], axis=1).astype("<f4")
    theirs = DracoPy.encode(xyz, quantization_bits=0, preserve_order=True)
    head = b"DRACO" + struct.pack("<BBBBHiBB", 2, 3, 0, 0, 0, COUNT, 1, 1) + bytes([0, 9, 3, 0, 0, 0])
    assert theirs == head + xyz.tobytes()


def test_the_fields_of_draco_are_those_of_the_cloud():
    packed = compressed(cloud(POINTS), "draco", draco(POINTS))
    columns = decode(packed).cloud.columns
    assert list(columns) == [name for name, _ in FIELDS]
    for name in columns:
        np.testing.assert_array_equal(columns[name], POINTS[name])
        assert columns[name].dtype == POINTS[name].dtype
    np.testing.assert_allclose(decode(packed).scan().time_s, POINTS["t"] * 1e-9, atol=1e-8)


def test_points_that_draco_dropped_are_not_missed():
    """Its publisher leaves out equal points, and says so by the width and the height."""
    packed = compressed(cloud(POINTS[:400]), "draco", draco(POINTS[:380]))
    assert len(decode(packed).cloud) == 380


def test_times_that_the_library_rounds_do_not_count():
    """DracoPy 2.2 makes float32 of float64: a step of times since the epoch is 128 s then."""
    points = np.zeros(COUNT, [*FIELDS[:3], ("timestamp", "<f8")])
    points["x"] = POINTS["x"]
    points["timestamp"] = 1.73e9 + np.linspace(0, 0.1, COUNT)
    stamped = decode(compressed(cloud(points), "draco", draco(points)))
    assert stamped.scan().time_s is None
    assert "timestamp" in stamped.cloud.columns  # whoever looks for times can say that it was not understood


@every_case(
    "form, said", [("cloudini", "cloudini_rosbag_converter"), ("lzma", "republish"), ("", "republish")]
)
def test_other_formats_say_what_unpacks_them(form: str, said: str):
    with pytest.raises(UnsupportedFormat, match=said):
        decode(compressed(cloud(POINTS), form, b"x" * 100))


@every_case("form", PACK)
def test_what_unpacks_to_more_than_the_cloud_is_refused(form: str):
    bomb = PACK[form](bytes(50_000_000))
    with pytest.raises((MalformedData, TooLarge)):
        decode(compressed(cloud(POINTS), form, bomb))
    with pytest.raises(MalformedData):
        decode(compressed(cloud(POINTS), form, PACK[form](cloud(POINTS).data.tobytes()[:-8])))
    with pytest.raises(TooLarge, match="500 points, the limit is 100"):
        decode(compressed(cloud(POINTS), form, bomb), limits=Limits(100, 10**6))
    with pytest.raises(TooLarge):
        decode(compressed(cloud(POINTS), form, bomb, height=2**31, row_step=2**31, width=0))


@every_case("form", ["zstd", "zlib", "draco"])
def test_damage_is_an_input_error(form: str):
    plain = cloud(POINTS)
    data = draco(POINTS) if form == "draco" else PACK[form](plain.data.tobytes())
    good, rng = raw(compressed(plain, form, data)), np.random.default_rng(4)
    for trial in range(150):
        body = bytearray(good.body)
        if trial % 3:
            body[rng.integers(len(body)) if trial % 3 == 1 else rng.integers(300)] ^= rng.integers(1, 256)
        else:
            body = body[: rng.integers(len(body))]
        with suppress(InputError):
            decode_compressed_cloud(PROCESS, RawMessage("/p", 0, bytes(body), good.type, CDR), SCAN_LIMITS)


def test_plain_clouds_are_preferred_to_packed_ones(tmp_path: Path):
    plain = cloud(POINTS)
    both = [
        ("/points", 5, plain),
        ("/points/zstd", 5, compressed(plain, "zstd", PACK["zstd"](plain.data.tobytes()))),
    ]
    with open_recording(write_bag(tmp_path, "mcap", both)) as recording:
        assert [topic.name for topic in recording.cloud_topics] == ["/points", "/points/zstd"]
        assert recording.cloud_topic(None).name == "/points"
        (recorded,) = recording.clouds(recording.cloud_topic("/points/zstd"))
        np.testing.assert_array_equal(recorded.cloud().cloud.xyz[:, 0], POINTS["x"])


@every_case("count, error", [(2**31 - 1, TooLarge), (2_000_001, TooLarge), (-1, MalformedData)])
def test_draco_cannot_take_memory_without_limit(count: int, error: type[InputError]):
    """The library trusts the number of points, and makes room for them."""
    body = bytearray(draco(POINTS))
    body[11:15] = struct.pack("<i", count)
    with pytest.raises(error, match="draco"):
        decode(compressed(cloud(POINTS), "draco", bytes(body)))
