"""Times of points under the names and in the units of drivers and file formats."""

import io

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.formats.point_times import point_times
from firstfix.scan_file import read_scan_file
from tests.core.formats.cloud_files import pcd, ply
from tests.every_case import every_case

N = 500
SWEEP_S = np.linspace(0, 0.1, N)
POINTS = np.random.default_rng(1).uniform(-20, 20, (N, 3)).astype(np.float32)
STAMP_S = 1_700_000_000.25


def columns(name: str, times: np.ndarray, **more: np.ndarray) -> dict[str, np.ndarray]:
    return {"x": POINTS[:, 0], "y": POINTS[:, 1], "z": POINTS[:, 2], name: times, **more}


@pytest.mark.parametrize(
    ("name", "times", "first_s"),
    [
        ("t", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Ouster
        ("offset_time", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Livox
        ("time", (SWEEP_S - 0.1).astype(np.float32), -0.1),  # Velodyne
        ("timestamp", STAMP_S - 0.05 + SWEEP_S, -0.05),  # Hesai, RoboSense
        ("timestamp", (STAMP_S + SWEEP_S) * 1e9, 0.0),  # Livox
        ("time_stamp", (SWEEP_S * 1e9).astype(np.uint32), 0.0),  # Autoware
        ("timestamp", STAMP_S + 40 + SWEEP_S, 0.0),  # another clock: from the first point
        ("time", (SWEEP_S + 1234.5), 0.0),  # since the sensor was switched on
        ("T", (SWEEP_S * 1e9), 0.0),  # an ascii file's numbers are all real
    ],
)
def test_times_of_drivers_are_read_in_their_units(name, times, first_s):
    found = point_times(columns(name, times), STAMP_S)
    assert found.time_s.dtype == np.float32
    np.testing.assert_allclose(found.time_s, first_s + SWEEP_S, atol=2e-6)
    assert found.stamp_s == STAMP_S


def test_without_a_stamp_the_first_point_since_the_epoch_is_it():
    found = point_times(columns("timestamp", STAMP_S + SWEEP_S[::-1]), None)
    assert found.stamp_s == STAMP_S
    np.testing.assert_allclose(found.time_s, SWEEP_S[::-1], atol=1e-6)
    assert point_times(columns("time", SWEEP_S), None).stamp_s is None


NONE = {
    "zeros": (np.zeros(N, np.uint32), "all are equal"),
    "one number": (np.full(N, STAMP_S), "all are equal"),
    "no numbers": (np.full(N, np.nan), "100% of the points have none"),
    "many are NaN": (np.where(np.arange(N) % 10 == 7, np.nan, SWEEP_S), "10% of the points have none"),
    "a thousand times finer than ns": (SWEEP_S * 1e12, "in no unit they span a turn"),
    "five seconds": ((np.arange(N) * 10_000_000).astype(np.uint32), "in no unit they span a turn"),
    "half a millisecond, or half a second": (
        (SWEEP_S * 5e6).astype(np.uint32),
        "in no unit they span a turn",
    ),
    "two minutes since the epoch": (STAMP_S + SWEEP_S * 1200, "by the clock these are 120 s"),
    "shares of a turn": (np.linspace(0, 1, N), "0 to 1 are shares of a turn"),
    "shares from the middle": (np.linspace(-0.5, 0.5, N).astype(np.float32), "-0.5 to 0.5 are shares"),
    "nanoseconds of a second that ends": (
        ((SWEEP_S + 0.95) % 1 * 1e9).astype(np.uint32),
        "in two parts, as if they had begun anew",
    ),
    "a few strays": (
        np.where(np.arange(N) % 50 == 7, 36.0, SWEEP_S),
        "most of the points have nearly the same",
    ),
    "seconds since the epoch in float32": ((STAMP_S + SWEEP_S).astype(np.float32), "all are equal"),
    "the same, in two steps": (
        np.where(np.arange(N) % 2, STAMP_S, STAMP_S + 128).astype(np.float32),
        "steps of 128: too coarse for a turn",
    ),
    "days since the start in float32": ((2e5 + SWEEP_S).astype(np.float32), "too coarse for a turn"),
}


@every_case("case", NONE)
def test_a_field_that_is_not_the_times_of_one_scan_is_named(case):
    times, why = NONE[case]
    found = point_times(columns("t", times), STAMP_S)
    assert found.time_s is None
    assert (found.field.name, found.field.type, found.field.unit) == ("t", times.dtype.name, None)
    assert why in found.field.why


def test_text_is_no_time():
    assert point_times(columns("t", SWEEP_S.astype("S8")), STAMP_S).field is None


UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
CLOCKS_S = {
    "stamp": 0.0,
    "before the stamp": -0.1,
    "epoch": STAMP_S,
    "own": 86_400.0,
    "another": STAMP_S + 37,
}


@every_case("clock", CLOCKS_S)
@every_case("unit", UNITS)
@every_case("span_s", [0.025, 0.05, 0.1, 0.2])
@every_case("kind", ["f8", "i8", "u8"])
def test_any_unit_is_told_by_the_span_of_a_turn(kind, span_s, unit, clock):
    """Also of windows: 25 ms are a half turn at 20 Hz."""
    if kind != "f8" and (unit == "s" or (kind == "u8" and CLOCKS_S[clock] < 0)):
        return
    scale, begin_s = UNITS[unit], CLOCKS_S[clock]
    exact = (np.linspace(0, span_s, N) + begin_s) * scale
    times = exact if kind == "f8" else np.round(exact).astype(kind)
    found = point_times(columns("timestamp", times), STAMP_S)
    assert (found.field.unit, found.field.clock) == (
        unit,
        clock.split()[0].replace("another", "own").replace("before", "stamp"),
    )
    first_s = begin_s if found.field.clock == "stamp" else 0.0
    step_s = 0.0 if kind == "f8" else 1 / scale
    np.testing.assert_allclose(found.time_s, first_s + np.linspace(0, span_s, N), atol=1e-6 + step_s)


@every_case(
    "name, times",
    [
        ("time_offset_ns", (SWEEP_S * 1e9).astype(np.int32)),  # Aeva, Nebula
        ("ts", SWEEP_S.astype(np.float32)),  # SICK
        ("offset", (SWEEP_S * 1e9).astype(np.uint32)),  # HeLiPR's Avia
        ("scalar_timestamp", SWEEP_S),  # CloudCompare
        ("laser_time", SWEEP_S),  # nobody's
        ("time_us", SWEEP_S * 5e3),  # half a millisecond: the name says so
    ],
)
def test_names_of_rarer_drivers(name, times):
    found = point_times(columns(name, times), STAMP_S)
    scale = 5e-3 if name == "time_us" else 1
    np.testing.assert_allclose(found.time_s, SWEEP_S * scale, atol=1e-6)


def test_one_time_in_two_fields():
    """Of Hesai's SDK; the second goes by in the middle of the turn."""
    whole = 1_700_000_000_950_000_000 + (SWEEP_S * 1e9).astype(np.int64)
    two = {
        "timeSecond": (whole // 10**9).astype(np.uint64),
        "timeNanosecond": (whole % 10**9).astype(np.uint32),
    }
    found = point_times({**columns("intensity", SWEEP_S), **two}, 1_700_000_000.95)
    np.testing.assert_allclose(found.time_s, SWEEP_S, atol=1e-6)
    assert found.field.name == "timeSecond+timeNanosecond"


def test_a_field_that_cannot_be_gives_way_to_the_next():
    for bad in (np.zeros(N, np.uint32), np.full(N, np.nan), SWEEP_S * 1e12):
        found = point_times({**columns("t", bad), "timestamp": STAMP_S + SWEEP_S}, STAMP_S)
        assert found.field.name == "timestamp"
        np.testing.assert_allclose(found.time_s, SWEEP_S, atol=1e-6)
    # of two that are not understood, the one that is not filled with zeros is named
    given = {**columns("t", np.zeros(N, np.uint32)), "timestamp": SWEEP_S * 1e12}
    assert point_times(given, STAMP_S).field.name == "timestamp"


def test_points_that_are_no_returns_do_not_vote():
    lost = np.arange(N) % 3 == 0
    origin = {axis: np.where(lost, 0, POINTS[:, k]) for k, axis in enumerate("xyz")}
    found = point_times({**origin, "timestamp": np.where(lost, 0, STAMP_S - 0.1 + SWEEP_S)}, STAMP_S)
    np.testing.assert_allclose(found.time_s[~lost], SWEEP_S[~lost] - 0.1, atol=1e-6)
    assert (found.time_s[lost] == found.time_s[~lost].min()).all()
    none = {**dict.fromkeys("xyz", np.zeros(N)), "timestamp": np.where(lost, 0, STAMP_S)}
    assert point_times(none, STAMP_S).time_s is None


@every_case("bad", [np.nan, np.inf, -np.inf])
def test_a_stray_number_that_is_none_gets_the_time_of_the_point_before(bad):
    found = point_times(columns("time", np.where(np.arange(N) == 7, bad, SWEEP_S)), None)
    np.testing.assert_allclose(np.delete(found.time_s, 7), np.delete(SWEEP_S, 7), atol=1e-6)
    assert found.time_s[7] == found.time_s[6]


def test_places_in_a_picture_are_no_times():
    assert point_times(columns("t", SWEEP_S, s=SWEEP_S), None).time_s is None
    assert point_times(columns("t", SWEEP_S), None).time_s is not None


def test_times_of_invalid_points_do_not_matter():
    lost = np.arange(N) % 3 == 0
    x = np.where(lost, np.nan, POINTS[:, 0])
    found = point_times({**columns("time", np.where(lost, np.nan, SWEEP_S)), "x": x}, None)
    np.testing.assert_allclose(found.time_s[~lost], SWEEP_S[~lost], atol=1e-6)
    assert (found.time_s[lost] == found.time_s[~lost].min()).all()


def test_a_pcd_and_a_ply_have_times(tmp_path):
    record = np.zeros(N, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    for axis, name in enumerate("xyz"):
        record[name] = POINTS[:, axis]
    record["t"] = SWEEP_S * 1e9
    bodies = (
        (pcd(record, "binary"), "application/x-pcd"),
        (ply(record, "binary_little_endian"), "application/ply"),
    )
    for body, media_type in bodies:
        scan = decode_query(body, media_type)
        np.testing.assert_allclose(scan.time_s, SWEEP_S, atol=1e-6)
    (tmp_path / "scan.pcd").write_bytes(bodies[0][0])
    assert read_scan_file(tmp_path / "scan.pcd").time_s is not None


def test_a_laz_scan_has_times(tmp_path):
    import laspy

    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 1e-3)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS.astype(np.float64).T
    cloud.gps_time = 432_000.5 + SWEEP_S  # seconds of the week
    buffer = io.BytesIO()
    cloud.write(buffer)
    (tmp_path / "scan.las").write_bytes(buffer.getvalue())
    scan = read_scan_file(tmp_path / "scan.las")
    np.testing.assert_allclose(scan.time_s, SWEEP_S, atol=1e-6)
    assert scan.stamp_s is None


WINDOW_S = np.linspace(0, 1, N)  # of a turn of 0.1 s, from 40 ms after the stamp on


@pytest.mark.parametrize(
    ("times", "window_s", "unit"),
    [
        (lambda t: np.rint((STAMP_S + t) * 1e3 * 1e3) / 1e3, 1e-3, None),  # ms, seen as 1 s of seconds
        (lambda t: (t - 0.1) * 1e3, 1e-3, None),  # the same before the stamp
        (lambda t: (t - 0.1) * 1e3, 4e-4, None),
        (lambda t: int(STAMP_S * 1e9) + np.rint(t * 1e9).astype(np.int64), 1e-4, None),  # ns as 0.1 s of us
        (lambda t: int(STAMP_S * 1e6) + np.rint(t * 1e6).astype(np.int64), 1e-4, None),  # us as 0.1 s of ms
        (lambda t: int(STAMP_S * 1e9) + np.rint(t * 1e9).astype(np.int64), 2e-3, "ns"),
        (lambda t: STAMP_S + t, 1e-3, "s"),
        (lambda t: STAMP_S + 37 + t, 0.5, "s"),
    ],
)
def test_a_part_of_a_turn_is_not_read_in_a_coarser_unit(times, window_s, unit):
    t = 0.04 + WINDOW_S * window_s
    found = point_times(columns("timestamp", times(t)), STAMP_S)
    assert found.field.unit == unit, found.field
    if unit is not None:
        own = found.field.clock == "own"
        np.testing.assert_allclose(found.time_s, t - t[0] * own, atol=2e-6)


def test_numbers_of_points_are_no_microseconds():
    count = 50_000
    points = np.random.default_rng(2).uniform(-20, 20, (3, count))
    found = point_times(dict(zip("xyz", points, strict=True)) | {"t": np.arange(count, dtype="u4")}, STAMP_S)
    assert found.time_s is None
    assert found.field.why == "they are the numbers of the points"


@pytest.mark.parametrize("kind", ["i1", "i2"])
def test_differences_of_small_numbers_do_not_overflow(kind):
    times = np.rint(SWEEP_S * 2e3 - 100 if kind == "i1" else SWEEP_S * 6e5 - 30_000).astype(kind)
    found = point_times(columns("time", times), STAMP_S)
    scale = 1e-3 if kind == "i1" else 1e-6
    np.testing.assert_allclose(found.time_s, times * scale, atol=1e-7)
