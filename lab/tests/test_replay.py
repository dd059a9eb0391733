"""``firstfix localize --bag``: queries, output and exit codes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.transform import from_quaternion, inverse, make_transform, rotation_z
from firstfix_cli.main import run
from tests import ros_samples
from tests.fake_service import FakeService
from tests.ros_samples import BAG_KINDS, cloud_of_points, stores_of, write_bag

S = 10**9
POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
BASE_LIDAR = from_quaternion([0.1, 0.0, 1.1], [0, 0, 0.5, 0.9])
LIDAR_IMU = from_quaternion([0.0, 0.0, -0.1], [0.7, 0, 0, 0.7])
DOWN = np.array([0.1, 0.2, -0.97]) / np.linalg.norm([0.1, 0.2, -0.97])  # in the lidar's frame
LOCALIZED, AMBIGUOUS, REJECTED = 100, 200, 300  # point counts: how the service tells clouds apart


@pytest.fixture
def service() -> Iterator[FakeService]:
    hypothesis = Hypothesis(POSE, AlignmentQuality(0.8, 0.7, 0.01), 0.5, 1)
    running = FakeService(
        {
            LOCALIZED: Localization(Verdict.LOCALIZED, (), POSE, None, np.eye(6), 0.99),
            AMBIGUOUS: Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), hypotheses=(hypothesis,)),
            REJECTED: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
        }
    )
    yield running
    running.stop()


def drive(kind: str, counts: list[int]) -> list[tuple[str, int, object]]:
    """Writes a bag: one cloud per second from 100 s, stamped 10 ms earlier; an IMU at rest; static frames."""
    stores, rng = stores_of(kind), np.random.default_rng(1)
    tree = [("base_link", "lidar", BASE_LIDAR), ("lidar", "imu_link", LIDAR_IMU)]
    up = -9.81 * (inverse(LIDAR_IMU)[:3, :3] @ DOWN)
    messages: list[tuple[str, int, object]] = [
        ("/tf_static", 99 * S, ros_samples.transforms(tree, stores=stores))
    ]
    for number, count in enumerate(counts):
        now = (100 + number) * S
        for step in range(5):
            imu_ns = now - (10 - step) * 10_000_000
            sample = ros_samples.imu(up, stores=stores, stamp_ns=imu_ns, frame_id="imu_link")
            messages.append(("/imu", imu_ns, sample))
        points = rng.uniform(-9, 9, (count, 3))
        stamp_ns = now - 10_000_000
        cloud = cloud_of_points(points, stores=stores, stamp_ns=stamp_ns, frame_id="lidar")
        messages.append(("/points", now, cloud))
    return messages


def ended(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


def replayed(service: FakeService, bag: Path, *more: object) -> int:
    return ended("localize", "--bag", bag, "--map", "hall", "--url", service.url, *more)


@pytest.mark.parametrize("kind", BAG_KINDS)
def test_a_line_for_every_cloud_and_a_trajectory(service, tmp_path, capsys, kind):
    bag = write_bag(tmp_path, kind, drive(kind, [REJECTED, LOCALIZED, AMBIGUOUS, LOCALIZED]))
    assert replayed(service, bag, "--tum", tmp_path / "out" / "fixes.txt") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines] == [
        ["99.990000000", "rejected"],
        ["100.990000000", "localized,"],
        ["101.990000000", "ambiguous"],
        ["102.990000000", "localized,"],
    ]
    assert "x 12.000  y -4.000  z 1.500 m  yaw 28.65 deg" in lines[1]
    rows = np.loadtxt(tmp_path / "out" / "fixes.txt")
    np.testing.assert_allclose(rows[:, 0], [100.99, 102.99])
    np.testing.assert_allclose(rows[0, 1:4], POSE[:3, 3])
    assert [len(scan) for scan in service.scans] == [REJECTED, LOCALIZED, AMBIGUOUS, LOCALIZED]
    assert "gravity" not in service.queries[0]


def test_json_lines(service, tmp_path, capsys):
    bag = write_bag(tmp_path, "mcap", drive("mcap", [LOCALIZED, REJECTED]))
    assert replayed(service, bag, "--json") == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert first["stamp"] == {"sec": 99, "nanosec": 990_000_000}
    assert first["frame_id"] == "lidar"
    np.testing.assert_allclose(Localization.from_mapping(first).T_map_sensor, POSE, atol=1e-12)
    assert second["verdict"] == "rejected"


@pytest.mark.parametrize(
    ("counts", "code"), [([REJECTED, AMBIGUOUS], 3), ([REJECTED], 4), ([REJECTED, LOCALIZED], 0)]
)
def test_the_best_verdict_is_the_exit_code(service, tmp_path, counts, code):
    assert replayed(service, write_bag(tmp_path, "sqlite3", drive("sqlite3", counts))) == code


def test_every_start_and_count(service, tmp_path, capsys):
    bag = write_bag(tmp_path, "ros1", drive("ros1", [LOCALIZED] * 10))
    assert replayed(service, bag, "--every", 3, "--start", 2.5, "--count", 2) == 0
    stamps = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert stamps == ["101.990000000", "104.990000000"]  # the bag begins at 99 s, with its transforms


@pytest.mark.parametrize("kind", BAG_KINDS)
def test_gravity_and_the_mounting_come_from_the_bag(service, tmp_path, kind):
    bag = write_bag(tmp_path, kind, drive(kind, [LOCALIZED, LOCALIZED]))
    assert replayed(service, bag, "--imu-topic", "/imu", "--base-frame", "base_link") == 0
    for query in service.queries:
        gravity = [float(v) for v in query["gravity"].split(",")]
        np.testing.assert_allclose(gravity, DOWN, atol=1e-9)
        seven = [float(v) for v in query["T_base_sensor"].split(",")]
        np.testing.assert_allclose(from_quaternion(seven[:3], seven[3:]), BASE_LIDAR, atol=1e-9)


def test_an_imu_that_moves_says_nothing(service, tmp_path):
    messages = drive("sqlite3", [LOCALIZED])
    for topic, _, message in messages:
        if topic == "/imu":
            message.linear_acceleration.x += 30.0
    assert replayed(service, write_bag(tmp_path, "sqlite3", messages), "--imu-topic", "/imu") == 0
    assert "gravity" not in service.queries[0]


WRONG = {
    "no such topic": (["--topic", "/camera"], "/camera has no clouds"),
    "an IMU topic that is none": (["--imu-topic", "/points"], "/points has no sensor_msgs/msg/Imu"),
    "a frame that nothing joins": (["--base-frame", "arm"], "no chain of static transforms"),
    "gravity twice": (["--imu-topic", "/imu", "--gravity", "0,0,-1"], "only one of --gravity"),
    "the mounting twice": (
        ["--base-frame", "base_link", "--T-base-sensor", "0,0,0,0,0,0,1"],
        "only one of --T-base-sensor",
    ),
    "nothing left": (["--start", "1000"], "no cloud after 1000 s"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_is_one_line(service, tmp_path, capsys, case):
    arguments, says = WRONG[case]
    bag = write_bag(tmp_path, "ros1 lz4", drive("ros1 lz4", [LOCALIZED]))
    assert replayed(service, bag, *arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert says in err


def test_a_damaged_message_is_named(service, tmp_path, capsys):
    messages = drive("mcap", [LOCALIZED, LOCALIZED])
    messages[-1][2].point_step = 11
    assert replayed(service, write_bag(tmp_path, "mcap", messages)) == 2
    out, err = capsys.readouterr()
    assert out.count("\n") == 1, "what came before it is answered"
    assert "recorded at 101000000000 ns: PointCloud2: " in err


def test_a_scan_or_a_bag(service, tmp_path, capsys):
    bag = write_bag(tmp_path, "mcap", drive("mcap", [LOCALIZED]))
    scan = tmp_path / "scan.npy"
    np.save(scan, np.ones((LOCALIZED, 3)))
    assert replayed(service, bag, scan) == 2
    assert "one of SCAN, --odometry and --bag" in capsys.readouterr().err
    service_of_it = ["--map", "hall", "--url", service.url]
    assert ended("localize", *service_of_it) == 2
    assert ended("localize", scan, *service_of_it, "--topic", "/points") == 2
    assert "need --bag" in capsys.readouterr().err
    assert ended("localize", scan, *service_of_it) == 0
