"""A scan as a range image: what goes in comes out, nearly, and nothing hostile gets further than an error."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from firstfix.decode import read_scan_file
from firstfix.errors import FirstfixError, InvalidOption, InvalidScan, MalformedData, TooLarge
from firstfix.scan import MAX_POINTS, Scan
from firstfix.wire import decode_scan, encode_scan
from firstfix.wire_range_image import COLUMNS, ROWS

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
HEADER_BYTES = 36

coordinates = st.floats(-900, 900, width=32)
clouds = hnp.arrays(np.float32, st.tuples(st.integers(0, 80), st.just(3)), elements=coordinates)


def image_of(scan: Scan, resolution_m: float | None = None) -> bytes:
    return encode_scan(scan, form="range_image", resolution_m=resolution_m)


def spinning(columns: int = 300, seed: int = 0) -> Scan:
    """Sixteen beams round and round: neighbours apart by metres here and there, and gaps of all sizes."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, columns, endpoint=False), np.radians(np.linspace(-15, 15, 16))
    )
    ranges = 20 + 9 * np.sign(np.sin(7 * azimuth)) + rng.normal(0, 0.02, azimuth.shape)
    across = ranges * np.cos(elevation)
    points = np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), ranges * np.sin(elevation)], axis=-1
    )
    points = points.reshape(-1, 3)[rng.random(azimuth.size) < 0.8]
    return Scan.from_points(points, None, 1_700_000_000.25)


def directions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuth and elevation in radians, and range."""
    x, y, z = points.astype(np.float64).T
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.sqrt(x * x + y * y + z * z)


def cells_of(points: np.ndarray) -> np.ndarray:
    azimuth, elevation, _ = directions(points)
    column = np.floor((azimuth / (2 * np.pi) + 0.5) * COLUMNS).astype(int) % COLUMNS
    row = np.minimum(np.floor((elevation / np.pi + 0.5) * ROWS).astype(int), ROWS - 1)
    return row * COLUMNS + column


def away_from_edges(points: np.ndarray) -> np.ndarray:
    """Whether double arithmetic is sure to find the same cell as float's."""
    azimuth, elevation, _ = directions(points)
    places = np.stack([azimuth * (COLUMNS / (2 * np.pi)), elevation * (ROWS / np.pi)])
    return (np.abs(places - np.rint(places)) > 0.01).all(axis=0)


@given(clouds, st.sampled_from([0.025, 0.05, 0.3, 1.0]))
@settings(max_examples=200, deadline=None)
def test_every_return_is_the_nearest_of_a_direction(cloud, resolution_m):
    """Each that comes back has a point within the bound, and each point one in its cell, no further off."""
    scan = Scan.from_points(cloud)
    back = decode_scan(image_of(scan, resolution_m)).points
    _, _, ranges = directions(back)
    reach = np.hypot(np.pi / COLUMNS, np.pi / (2 * ROWS)) * 1.001  # to a cell's corner
    for point, range_m in zip(back, ranges, strict=True):
        off = np.linalg.norm(scan.points.astype(np.float64) - point, axis=1).min()
        assert off <= resolution_m / 2 + reach * (range_m + resolution_m) + 1e-4
    assert len(np.unique(cells_of(back))) == len(back)
    nearest = dict(zip(cells_of(back).tolist(), ranges.tolist(), strict=True))
    inside = scan.points[away_from_edges(scan.points)]
    _, _, given_m = directions(inside)
    for cell, range_m in zip(cells_of(inside).tolist(), given_m.tolist(), strict=True):
        if resolution_m * 0.51 < range_m < resolution_m * 65_535:
            assert nearest[cell] <= range_m + resolution_m * 0.51


@given(clouds)
@settings(max_examples=100, deadline=None)
def test_what_is_read_is_written_again(cloud):
    body = image_of(Scan.from_points(cloud), 0.05)
    assert image_of(decode_scan(body), 0.05) == body


def test_the_order_of_the_points_does_not_matter():
    scan = spinning()
    mixed = np.random.default_rng(1).permutation(len(scan))
    twice = np.concatenate([scan.points[mixed], scan.points])
    assert image_of(Scan(twice, None, scan.stamp_s)) == image_of(scan)


def test_a_sweep_comes_back_row_by_row():
    scan = spinning()
    back = decode_scan(image_of(scan))
    assert len(back) == len(scan)
    assert (np.diff(cells_of(back.points)) > 0).all()
    assert back.stamp_s == scan.stamp_s
    there, here = (
        points[np.lexsort(np.round(directions(points)[:2], 2))] for points in (scan.points, back.points)
    )
    assert np.linalg.norm(there - here, axis=1).max() < 0.0125 + 29 * np.hypot(np.pi / 4096, np.pi / 2048)


def test_poles_the_seam_and_what_is_no_direction():
    points = [[0, 0, 5], [0, 0, -5], [-2, 0, 0], [-2, -0.0, 0], [-2, 1e-30, 0], [-2, 0.01, 0]]
    points += [[0, 0, 0], [0.01, 0, 0]]
    back = decode_scan(image_of(Scan.from_points(points))).points
    # one cell behind the seam and one before it; nothing at the origin, and nothing of a hundredth of a metre
    assert np.round(back, 1).tolist() == [[0, 0, -5], [-2, 0, 0], [-2, 0, 0], [0, 0, 5]]


def test_returns_beyond_its_reach_are_left_out():
    points = [[300, 0, 0], [0, 340, 0]]
    assert len(decode_scan(image_of(Scan.from_points(points), 0.005))) == 1
    assert len(decode_scan(image_of(Scan.from_points(points), 0.01))) == 2


def test_the_intensity_stays_at_home():
    scan = Scan.from_points([[1, 2, 3]], [7])
    assert decode_scan(image_of(scan)).intensity is None


@pytest.mark.parametrize("resolution_m", [0.0049, 0.0, 1.01, float("nan"), -1.0])
def test_senseless_resolutions_are_refused(resolution_m):
    with pytest.raises(InvalidOption):
        image_of(spinning(), resolution_m)


def test_no_other_form_is_known():
    with pytest.raises(InvalidOption, match="smoke"):
        encode_scan(spinning(), form="smoke")


@pytest.mark.parametrize("bad", [np.nan, np.inf, 5000])
def test_coordinates_that_skipped_the_check_are_refused(bad):
    with pytest.raises(InvalidScan):
        image_of(Scan(np.array([[bad, 0, 0]], np.float32)))


def body_of(
    columns: int, rows: int, halves: list[int], gaps: list[int], ranges: list[int], wide: list[int]
) -> bytes:
    """An independent writer, from the layout in the module's docstring."""
    packed = [high << 4 | low for high, low in zip(halves[::2], [*halves[1::2], 0], strict=False)]
    first = bytes(packed) + b"".join(bytes(gap >> shift & 255 for gap in gaps) for shift in (0, 8, 16))
    second = bytes(ranges) + b"".join(bytes(number >> shift & 255 for number in wide) for shift in (0, 8))
    frame = zstandard.ZstdCompressor(level=7).compress(first)
    header = struct.pack("<4sBBHIHHddI", b"FFSC", 1, 2, columns, len(ranges), rows, 0, 0.5, 7.5, len(frame))
    return header + frame + zstandard.ZstdCompressor(level=7).compress(second)


def test_the_bytes_are_what_the_documentation_says():
    """On a grid of 8 by 4 cells, at half a metre: cells 0, 1, 17 and 31; 4, 4.5, 204.5 and 4 m."""
    body = body_of(8, 4, [0, 0, 15, 13], [15], [16, 2, 255, 255], [800, 801])
    scan = decode_scan(body)
    assert scan.stamp_s == 7.5
    azimuth, elevation, ranges = directions(scan.points)
    np.testing.assert_allclose(ranges, [4, 4.5, 204.5, 4], rtol=1e-6)
    np.testing.assert_allclose(np.degrees(azimuth), [-157.5, -112.5, -112.5, 157.5], rtol=1e-6)
    np.testing.assert_allclose(np.degrees(elevation), [-67.5, -67.5, 22.5, 67.5], rtol=1e-6)


@pytest.mark.parametrize(
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


def test_the_largest_grid_is_read():
    scan = decode_scan(body_of(65_535, 256, [15], [65_535 * 256 - 1], [2], []))
    assert scan.points.shape == (1, 3)


@pytest.mark.parametrize(
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
    """Of the header, and of what is in the frames."""
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


@pytest.mark.parametrize("frame", [0, 1])
@pytest.mark.parametrize("declared", [True, False])
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


@pytest.mark.parametrize(
    ("folder", "returns"), [("kitti_drive0027_street", 0.98), ("hilti_hall_indoor", 0.99)]
)
def test_a_real_scan_takes_under_90_kb(folder, returns):
    paths = sorted((DATA / folder / "queries").glob("*.pcd"))
    if not paths:
        pytest.skip("the shared scans are not here")
    for path in paths:
        scan = read_scan_file(path)
        body = image_of(scan)
        assert len(body) < 90_000
        assert len(decode_scan(body)) >= returns * len(scan)
