"""PointCloud2 in C++: what the Python reader makes of it, to the last bit, and its words of refusal."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import FirstfixError
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix.scan.scan import Scan
from tests.core.formats.test_point_times import NONE, STAMP_S
from tests.core.ros.test_ros_point_cloud2 import BAD, LAYOUTS, OUSTER, records
from tests.cpp.cpp_build import Build
from tests.driver_clouds import LAYOUTS as DRIVERS
from tests.robots.real_ros import RealRos, real_ros
from tests.ros_samples import cdr, cloud, cloud_of_points
from tests.waiting import LIMIT_S

PROGRAM = "firstfix_clouds"
STAMP_NS = 1_700_000_000_250_000_000
_XYZ = [("x", "f4"), ("y", "f4"), ("z", "f4")]


def read_by_python(body: bytes) -> tuple[str, bytes]:
    """A message as the program tells of it: its line, and its numbers."""
    try:
        stamped = decode_point_cloud2(body, SCAN_LIMITS)
        scan = stamped.scan()
    except FirstfixError as error:
        return f"error {_printable(f'{error.code}: {error}')}", b""
    left_out, field = scan.dropped, scan.time_field
    facts = [len(scan), f"{scan.stamp_s or 0:.17g}", _printable(stamped.header.frame_id), left_out.not_finite]
    facts += [left_out.too_far, f"{left_out.far_m:.17g}", f"{left_out.spread_m:.17g}"]
    facts += [int(scan.intensity is not None), int(scan.time_s is not None)]
    line = "ok " + " ".join(map(str, facts))
    if field is not None:
        line += "".join(f"\t{_printable(text)}" for text in (field.described, field.clock or "", field.why))
    return line, b"".join(part.tobytes() for part in _numbers(scan))


def _printable(text: str) -> str:
    """A text as the program prints it: up to a zero byte."""
    plain = text.encode().split(b"\0")[0]
    return "".join(chr(b) if 32 <= b < 127 and b != 92 else f"\\x{b:02x}" for b in plain)


def _numbers(scan: Scan) -> list[np.ndarray]:
    return [part for part in (scan.points, scan.intensity, scan.time_s) if part is not None]


def compared(build: Build, bodies: Sequence[bytes], folder: Path) -> list[str]:
    """Compares what the program makes of the messages with what Python makes of them. Returns the lines."""
    paths = []
    for number, body in enumerate(bodies):
        paths.append(folder / f"{number}.cdr")
        paths[-1].write_bytes(body)
    done = build.run(PROGRAM, folder / "numbers", *paths)
    assert done.returncode == 0, done.stderr
    found, numbers = done.stdout.splitlines(), (folder / "numbers").read_bytes()
    wanted = [read_by_python(body) for body in bodies]
    assert found == [line for line, _ in wanted]
    assert numbers == b"".join(part for _, part in wanted)
    return found


def with_times(name: str, times: np.ndarray, rng: np.random.Generator, *, lost: str = "none") -> np.ndarray:
    """A cloud with one more field; some of its points may be no returns."""
    made = np.zeros(len(times), np.dtype([*_XYZ, (name, times.dtype.str[1:])]))
    for axis in "xyz":
        made[axis] = rng.uniform(-20, 20, len(times))
    made[name] = times
    if lost != "none":
        rows = rng.random(len(times)) < 0.2
        for axis in "xyz":
            made[axis][rows] = np.nan if lost == "nan" else 0.0
        made[name][rows] = 0
    return made


def test_every_layout_in_both_byte_orders(on_board: Build, tmp_path: Path):
    bodies = [
        cdr(cloud(records(layout, order=order)), little_endian=is_little)
        for layout in LAYOUTS.values()
        for order in "<>"
        for is_little in (True, False)
    ]
    bodies += [cdr(cloud(records(OUSTER, (16, 32), order), row_padding=7)) for order in "<>"]
    capitals = records({"names": ["X", "Z", "Y", "x", "I"], "formats": ["f4", "f8", "f4", "f4", "i8"]})
    bodies += [
        cdr(cloud(records([*_XYZ, ("intensity", kind)]))) for kind in ("u1", "i2", "u4", "i8", "u8", "f8")
    ]
    bodies += [
        cdr(cloud(capitals)),
        cdr(cloud(records(OUSTER, (0,)))),
        cdr(cloud(records(OUSTER), stamp_ns=0)),
    ]
    assert all(line.startswith("ok ") for line in compared(on_board, bodies, tmp_path))


def test_clouds_as_drivers_write_them(on_board: Build, tmp_path: Path):
    rng = np.random.default_rng(2)
    bodies = [
        driver.message(rng.uniform(-30, 30, (400, 3)), np.linspace(0, span_s, 400))
        for driver in DRIVERS.values()
        for span_s in (0.1, 0.05, 0.02, 0.004)
    ]
    lines = compared(on_board, bodies, tmp_path)
    assert sum(line.split("\t")[0].endswith(" 1") for line in lines) >= len(DRIVERS)


def test_times_in_any_form(on_board: Build, tmp_path: Path):
    """Names, units, types, clocks and faults of fields, by chance."""
    rng = np.random.default_rng(3)
    bodies = [
        cdr(cloud(with_times("t", times, rng, lost=lost), stamp_ns=STAMP_NS))
        for times, _ in NONE.values()
        for lost in ("none", "zero", "nan")
    ]
    names = (
        "t",
        "offset_time",
        "Timestamp",
        "scalar_time",
        "time_us",
        "dt (ms)",
        "x_stamp_nanoseconds",
        "line time",
        "ts",
    )
    for _ in range(400):
        count = int(rng.integers(1, 600))
        begin_s = rng.choice([0.0, -0.1, STAMP_S, 86_400.0, STAMP_S + 37, -3e5])
        exact = (np.linspace(0, 10 ** rng.uniform(-4, 1), count) + begin_s) * rng.choice([1, 1e3, 1e6, 1e9])
        with np.errstate(invalid="ignore", over="ignore"):
            times = exact.astype(rng.choice(["f4", "f8", "i4", "u4", "i8", "u8", "i2", "u1"]))
        if rng.random() < 0.3:
            rng.shuffle(times)
        if rng.random() < 0.2 and times.dtype.kind == "f":
            times[rng.random(count) < rng.choice([0.005, 0.3])] = rng.choice([np.nan, np.inf])
        made = with_times(str(rng.choice(names)), times, rng, lost=str(rng.choice(["none", "zero", "nan"])))
        bodies.append(cdr(cloud(made, stamp_ns=int(rng.choice([0, STAMP_NS])))))
    lines = compared(on_board, bodies, tmp_path)
    taken = sum(line.split("\t")[0].endswith(" 1") for line in lines)
    assert min(taken, len(lines) - taken) > len(lines) / 10


def test_a_time_in_two_fields_and_fields_of_several_names(on_board: Build, tmp_path: Path):
    rng, seconds = np.random.default_rng(4), np.linspace(0.95, 1.05, 300)
    made = np.zeros(300, [*_XYZ, ("t", "u4"), ("timeSecond", "u8"), ("timeNanosecond", "u4"), ("time", "f4")])
    for axis in "xyz":
        made[axis] = rng.uniform(-20, 20, 300)
    made["timeSecond"] = 1_700_000_000 + np.floor(seconds)
    made["timeNanosecond"] = seconds % 1 * 1e9
    first = made.copy()
    first["t"] = np.linspace(0, 1e8, 300)
    real = made.astype([*_XYZ, ("t", "u4"), ("timeSecond", "f8"), ("timeNanosecond", "f8"), ("time", "f4")])
    real["timeSecond"][7] = np.nan
    bodies = [cdr(cloud(one, stamp_ns=1_700_000_001_000_000_000)) for one in (made, first, real)]
    lines = compared(on_board, bodies, tmp_path)
    assert "timeSecond+timeNanosecond (int64" in lines[0]


def test_points_that_are_left_out_are_counted(on_board: Build, tmp_path: Path):
    bodies = []
    for kind in ("f4", "f8"):
        for count in (0, 1, 2, 4_500):
            made = np.zeros(5_000, [(axis, kind) for axis in "xyz"])
            for axis, middle in zip("xyz", (5e5, 4.2e6, 100.0), strict=True):
                made[axis] = np.random.default_rng(5).normal(0, 20, 5_000)
                made[axis][:count] += middle
            made["y"][4_990:] = np.nan
            made["x"][4_980:4_985] = np.finfo(kind).max
            made["z"][4_970] = 1000.00001
            bodies.append(cdr(cloud(made)))
    assert all(line.startswith("ok ") for line in compared(on_board, bodies, tmp_path))


def test_contradictory_messages_are_refused_in_the_words_of_a_service(on_board: Build, tmp_path: Path):
    bodies = [cdr(cloud_of_points(np.ones((50, 3)), **replaced)) for replaced, _, _ in BAD.values()]
    good = cdr(cloud_of_points(np.ones((2, 3))))
    for at, wrong in ((4, b"\xff\xff\xff\xff"), (8, b"\x00\xca\x9a\x3b"), (0, b"\x00\x03"), (0, b"\xff\xff")):
        bodies.append(good[:at] + wrong + good[at + len(wrong) :])
    bodies += [b"", b"\x00\x01", good + b"\0\0\0", good + b"\0\0\0\0"]
    lines = compared(on_board, bodies, tmp_path)
    assert sum(line.startswith("error ") for line in lines) == len(bodies) - 1


def test_rows_without_points_take_no_time(on_board: Build, tmp_path: Path):
    """A message of a hundred bytes may name four thousand million of them."""
    rows = cdr(cloud_of_points(np.ones((0, 3)), height=2**32 - 1, width=0, row_step=0))
    assert len(compared(on_board, [rows] * 50, tmp_path)) == 50


@pytest.mark.slow
def test_damaged_messages_are_read_as_in_python_and_nothing_beyond_them(
    sanitised_on_board: Build, tmp_path: Path
):
    rng = np.random.default_rng(6)
    made = records(OUSTER, (3, 4))
    made["t"] = np.linspace(0, 1e8, 12).reshape(3, 4)
    good = [cdr(cloud(made, row_padding=3), little_endian=is_little) for is_little in (True, False)]
    bodies = [body[:size] for body in good for size in range(len(body))]
    for _ in range(2_000):
        wrong = bytearray(good[rng.integers(2)])
        for at in rng.integers(0, len(wrong), rng.integers(1, 4)):
            wrong[at] = rng.choice([0, 1, 255, rng.integers(256)])
        bodies.append(bytes(wrong))
    found = []
    for begin in range(0, len(bodies), 500):
        found += compared(sanitised_on_board, bodies[begin : begin + 500], tmp_path)
    assert len({line.split(":")[0] for line in found}) > 3


SERIALISE = """
import sys
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
for path in sys.argv[1:]:
    message = deserialize_message(open(path, "rb").read(), PointCloud2)
    open(path, "wb").write(serialize_message(message))
"""


@pytest.fixture(scope="module")
def ros() -> RealRos:
    """ROS 2 Jazzy."""
    return real_ros("jazzy")


@pytest.mark.slow
def test_messages_that_rclpy_wrote(on_board: Build, ros: RealRos, tmp_path: Path):
    rng = np.random.default_rng(7)
    paths = []
    for driver in DRIVERS.values():
        paths.append(tmp_path / f"{len(paths)}.ros")
        paths[-1].write_bytes(driver.message(rng.uniform(-30, 30, (200, 3)), np.linspace(0, 0.1, 200)))
    command = [str(ros.python), "-c", SERIALISE, *map(str, paths)]
    subprocess.run(command, env=ros.environment(0), check=True, timeout=LIMIT_S)
    compared(on_board, [path.read_bytes() for path in paths], tmp_path)
