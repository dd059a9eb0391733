"""Damaged bodies of every encoding: an input error or a sane scan, in little memory."""

from __future__ import annotations

import gzip
import math
import struct
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.decode import decode_query as decode_media_type
from firstfix.errors import InputError, InvalidScan, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.formats.text import decode_text
from firstfix.scan.compact import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.wire.content_encoding import undo_content_encoding
from firstfix.wire.query import decode_query, encode_query
from firstfix.wire.scan import decode_scan, encode_scan
from firstfix.wire.sequence import decode_scans
from tests.core.fixtures import in_memory_of
from tests.core.formats.cloud_files import pcd, ply, random_cloud, text_rows
from tests.core.wire.samples import SEQUENCE, body_of, compact, described, image_of, spinning, street_scan
from tests.every_case import every_case
from tests.hostile_bodies import npy
from tests.ros_samples import cdr, cloud

NAN, INF = math.nan, math.inf
CLOUD = random_cloud(12)
PLAIN = bytes(np.random.default_rng(5).integers(0, 20, 500, np.uint8))


def zstd_without_size(data: bytes) -> bytes:
    stream = zstandard.ZstdCompressor().compressobj()
    return stream.compress(data) + stream.flush()


class Encoding(NamedTuple):
    """A good body, and what decodes it.

    ``lengths`` has the place and form of the length of each zstd frame behind the header, or None for a
    frame up to the end.
    """

    body: bytes
    decode: Callable[[bytes], Any]
    header_bytes: int = 0
    lengths: tuple[tuple[int, str] | None, ...] = ()
    any_intensity: bool = False

    def frames(self) -> list[slice]:
        found, at = [], self.header_bytes
        for where in self.lengths:
            end = at + struct.unpack_from(where[1], self.body, where[0])[0] if where else len(self.body)
            found.append(slice(at, end))
            at = end
        return found

    def with_frame(self, number: int, frame: bytes) -> bytes:
        place = self.frames()[number]
        body = bytearray(self.body[: place.start] + frame + self.body[place.stop :])
        if (where := self.lengths[number]) is not None:
            struct.pack_into(where[1], body, where[0], len(frame))
        return bytes(body)


WIRE = {
    "points": Encoding(encode_scan(street_scan(n=40)), decode_scan, 64, (None,)),
    "range image": Encoding(image_of(spinning(20)), decode_scan, 36, ((32, "<I"), None)),
    "compact": Encoding(encode_query(compact()), decode_query, 30, ((26, "<H"), (28, "<H"))),
    "descriptor": Encoding(encode_query(described()), decode_query, 60, ((14, "<H"),)),
    "sequence": Encoding(SEQUENCE, decode_scans),
}
PACKED = {
    f"{name} {pack.__name__}": Encoding(
        pack(PLAIN), lambda body, name=name: undo_content_encoding(body, name, 1000)
    )
    for name, pack in (("gzip", gzip.compress), ("zstd", zstandard.compress), ("zstd", zstd_without_size))
}
FORMATS = {
    "pcd ascii": (pcd(CLOUD, "ascii"), "application/x-pcd"),
    "pcd binary": (pcd(CLOUD, "binary"), "application/x-pcd"),
    "pcd compressed": (pcd(CLOUD, "binary_compressed"), "application/x-pcd"),
    "ply ascii": (ply(CLOUD, "ascii"), "application/ply"),
    "ply little": (ply(CLOUD, "binary_little_endian"), "application/ply"),
    "ply big": (ply(CLOUD, "binary_big_endian"), "application/ply"),
    "xyz": (np.zeros((12, 3), "<f4").tobytes(), "application/vnd.firstfix.xyz"),
    "xyzi": (np.zeros((12, 4), "<f4").tobytes(), "application/vnd.firstfix.xyzi"),
    "npy": (npy(np.zeros((12, 4), "<f4")), "application/x-npy"),
    "npy records": (npy(CLOUD), "application/octet-stream"),
    "csv": (text_rows(CLOUD, ","), "text/csv"),
    "cdr": (cdr(cloud(CLOUD)), "application/vnd.ros2.cdr"),
    "cdr big": (cdr(cloud(CLOUD), little_endian=False), "application/cdr"),
}
ENCODINGS = {**WIRE, **PACKED} | {
    name: Encoding(body, lambda body, kind=kind: decode_media_type(body, kind), any_intensity=True)
    for name, (body, kind) in FORMATS.items()
}
each_encoding = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in FORMATS)) for name in ENCODINGS]
)
WORDS = b"-1 0 99999999999999999999 1e308 nan inf list \0 \xff".split(b" ") + [b"\n"]


def is_sane(found: Any, *, any_intensity: bool = False) -> bool:
    """Whether it could be a scan.

    Args:
        any_intensity: it may be any float32, as in the files of others; ours have one byte for it.
    """
    if isinstance(found, Scan):
        intensity = np.zeros(1) if found.intensity is None or any_intensity else found.intensity
        return bool(np.isfinite(found.points).all() and np.isfinite(intensity).all())
    if isinstance(found, CompactScan):
        nested = found.described is None or is_sane(found.described)
        return bool(np.isfinite(found.points).all() and (found.nearest_m >= 0).all() and nested)
    if isinstance(found, ScanDescriptor):
        return bool(abs(np.linalg.norm(found.up) - 1) < 1e-5 and np.isfinite(found.height_m))
    return isinstance(found, bytes) or 1 <= len(found) <= 16


def decode_or_refuse(encoding: Encoding, body: bytes) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = encoding.decode(body)
    except InputError:
        return
    assert is_sane(found, any_intensity=encoding.any_intensity)


@every_case("name", ENCODINGS)
def test_a_whole_body_is_decoded(name):
    assert is_sane(ENCODINGS[name].decode(ENCODINGS[name].body))


@every_case("name", [*WIRE, *PACKED])
def test_every_truncation_and_bytes_after_the_end_are_malformed(name):
    body, decode, *_ = ENCODINGS[name]
    for damaged in (*(body[:length] for length in range(len(body))), body + b"\0", body + body):
        with pytest.raises(MalformedData):
            decode(damaged)


@pytest.mark.slow
@every_case("name", FORMATS)
def test_a_truncated_file_is_an_input_error_or_a_scan(name):
    for length in range(len(ENCODINGS[name].body)):
        decode_or_refuse(ENCODINGS[name], ENCODINGS[name].body[:length])


@every_case("name", ["points", "range image"])
def test_every_bit_flip_of_a_frame_is_found(name):
    body, decode, header_bytes, *_ = WIRE[name]
    points = decode(body).points
    for bit in range(8 * header_bytes, 8 * len(body)):
        damaged = bytearray(body)
        damaged[bit // 8] ^= 1 << bit % 8
        try:
            back = decode(bytes(damaged))
        except InputError:
            continue
        # zstd has bits without meaning (its reserved ones are ignored): the points must be the same
        np.testing.assert_array_equal(back.points, points)


@each_encoding
@given(data=st.data())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_a_damaged_body_is_an_input_error_or_a_sane_scan(name, data):
    """Damages the body, or what one of its frames holds."""
    encoding, frame = ENCODINGS[name], None
    part = bytearray(encoding.body)
    if encoding.lengths and data.draw(st.booleans()):
        frame = data.draw(st.integers(0, len(encoding.lengths) - 1))
        part = bytearray(zstandard.decompress(encoding.body[encoding.frames()[frame]]))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(part) - 1))
        kind = data.draw(st.sampled_from(["flip", "insert", "remove", "word"]))
        if kind == "flip":
            part[place] ^= data.draw(st.integers(1, 255))
        elif kind == "insert":
            part[place:place] = data.draw(st.binary(min_size=1, max_size=20))
        elif kind == "remove":
            del part[place : place + data.draw(st.integers(1, 30))]
            part = part or bytearray(b"x")
        else:
            part[place : place + 2] = data.draw(st.sampled_from(WORDS))
    body = bytes(part) if frame is None else encoding.with_frame(frame, zstandard.compress(bytes(part)))
    with in_memory_of(2_000_000):
        decode_or_refuse(encoding, body)


STARTS = {"points": b"", "compact": b"FFQY\1\1\0\0", "descriptor": b"FFQY\1\2\0\0"}


@each_encoding
@given(noise=st.binary(max_size=300))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_noise_is_an_input_error_or_a_sane_scan(name, noise):
    if name in STARTS:
        with pytest.raises(InputError):
            ENCODINGS[name].decode(STARTS[name] + noise)
    decode_or_refuse(ENCODINGS[name], noise)


@pytest.mark.slow
@given(
    body=st.binary(max_size=400), glue=st.sampled_from([b"", b"x,y,z\n", b"1 2 3\n", b"5\n", b"# x y z\n"])
)
@settings(max_examples=300, deadline=None, derandomize=True)
def test_noise_in_a_text_or_a_bin_file_is_an_input_error_or_a_cloud(glue, body):
    for decode in (
        lambda: decode_text(glue + body, SCAN_LIMITS),
        lambda: decode_text(text_rows(CLOUD) + body, SCAN_LIMITS),
        lambda: decode_scanner_bin(body, "a.bin", SCAN_LIMITS),
        lambda: decode_scanner_bin(body, "a.velodyne_sync.bin", SCAN_LIMITS),
    ):
        try:
            decode()
        except InputError:
            continue


@every_case(
    ("name", "offset", "form", "value", "error"),
    [
        ("points", 0, "4s", b"LASF", MalformedData),
        ("points", 4, "B", 2, UnsupportedFormat),
        ("points", 5, "B", 0, UnsupportedFormat),
        ("points", 5, "B", 3, UnsupportedFormat),
        ("points", 6, "B", 3, MalformedData),
        ("points", 7, "B", 4, MalformedData),
        *[("points", 8, "I", count, MalformedData if count < MAX_POINTS else TooLarge)
          for count in (39, MAX_POINTS + 1, 2**32 - 1)],
        ("points", 12, "I", 1, MalformedData),
        *[("points", 16, "d", step, MalformedData) for step in (0.0, NAN)],
        *[("points", at, "d", INF, MalformedData) for at in (24, 48)],
        ("points", 56, "f", INF, MalformedData),
        ("points", 60, "f", NAN, MalformedData),
        ("range image", 6, "H", 2, MalformedData),
        ("range image", 8, "I", 1, MalformedData),
        *[("range image", 8, "I", count, TooLarge) for count in (MAX_POINTS + 1, 2**32 - 1)],
        *[("range image", 12, "H", columns, MalformedData) for columns in (0, 65_535)],
        ("range image", 14, "H", 1, MalformedData),
        *[("range image", 16, "d", step, MalformedData) for step in (0.0, NAN)],
        ("range image", 24, "d", INF, MalformedData),
        *[("range image", 32, "I", length, MalformedData) for length in (0, 2**32 - 1)],
        ("compact", 0, "4s", b"FFSC", MalformedData),
        ("compact", 4, "B", 2, UnsupportedFormat),
        *[("compact", 5, "B", kind, UnsupportedFormat) for kind in (0, 4)],
        ("compact", 6, "H", 1, MalformedData),
        *[("compact", 8, "f", step, MalformedData) for step in (0.0, NAN)],
        ("compact", 12, "H", 399, MalformedData),
        ("compact", 12, "H", MAX_COMPACT_POINTS + 1, TooLarge),
        ("compact", 20, "H", 0, MalformedData),
        ("compact", 20, "3H", (1, 1, 1), MalformedData),
        ("compact", 26, "H", 3, MalformedData),
        ("compact", 28, "H", 65535, MalformedData),
        ("descriptor", 8, "B", 2, UnsupportedFormat),
        *[("descriptor", 9, "B", layers, MalformedData) for layers in (0, 17)],
        *[("descriptor", 10, "H", rings, MalformedData) for rings in (0, 21)],
        ("descriptor", 12, "H", 721, MalformedData),
        ("descriptor", 14, "H", 1, MalformedData),
        *[("descriptor", 16, "f", range_m, MalformedData) for range_m in (INF, -1.0)],
        *[("descriptor", 20, "f", up, MalformedData) for up in (0.5, NAN)],
        ("descriptor", 32, "f", NAN, MalformedData),
        *[("descriptor", 36, "f", edge_m, MalformedData) for edge_m in (NAN, 1.5, -INF)],
        ("sequence", 0, "4s", b"FFSC", MalformedData),
        ("sequence", 4, "B", 2, UnsupportedFormat),
        *[("sequence", 5, "B", count, MalformedData) for count in (0, 4)],
        ("sequence", 5, "B", 17, TooLarge),
        *[("sequence", 8, "7d", pose, InvalidScan) for pose in ((0,) * 7, (NAN, 0, 0, 0, 0, 0, 1))],
        ("sequence", 64, "I", 2**32 - 1, MalformedData),
    ],
)  # fmt: skip
def test_each_header_field_is_checked(name, offset, form, value, error):
    body = bytearray(WIRE[name].body)
    struct.pack_into(f"<{form}", body, offset, *(value if isinstance(value, tuple) else [value]))
    with pytest.raises(error):
        WIRE[name].decode(bytes(body))


def test_a_sequence_without_scans_is_invalid():
    with pytest.raises(InvalidScan):
        decode_scans(b"FFSS\x01\x00\x00\x00")


@every_case("form", ["points", "range_image"])
def test_coordinates_out_of_range_are_malformed(form):
    body = bytearray(encode_scan(Scan.from_points([[100, 0, 0]]), form=form))
    struct.pack_into("<d", body, 16, 0.5)
    with pytest.raises(MalformedData, match="beyond"):
        decode_scan(bytes(body))


@every_case(("name", "frame"), [(name, n) for name, one in WIRE.items() for n in range(len(one.lengths))])
@every_case("declared", [True, False])
def test_a_bomb_is_refused_before_its_memory_is_taken(name, frame, declared):
    bomb = zstandard.ZstdCompressor(write_content_size=declared).compress(bytes(300_000_000))
    with in_memory_of(1_000_000), pytest.raises(MalformedData):
        WIRE[name].decode(WIRE[name].with_frame(frame, bomb))


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
def test_a_range_image_that_contradicts_itself_is_malformed(body):
    with pytest.raises(MalformedData):
        decode_scan(body)


def test_as_many_returns_as_there_may_be_take_bounded_memory():
    count = MAX_POINTS
    gaps = zstandard.compress(bytes(count // 2))
    ranges = zstandard.compress(bytes([8]) + bytes(count - 1))
    head = struct.pack("<4sBBHIHHddI", b"FFSC", 1, 2, 4096, count, 4096, 0, 0.5, 0.0, len(gaps))
    with in_memory_of(100 * count):
        assert len(decode_scan(head + gaps + ranges)) == count
