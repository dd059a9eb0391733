"""Bags are localized by the real engine: one of the small world, and that of the real hall if present."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import from_quaternion, inverse, pose_error
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.bags.replay import Replay, replay
from tests import ros_samples
from tests.recorded_data import SHARED
from tests.ros_samples import BAG_KINDS, cloud_of_points, stores_of, write_bag

S = 10**9
BASE_LIDAR = from_quaternion([0.2, 0.0, 0.7], [0, 0, 0.6, 0.8])


@pytest.mark.parametrize("kind", BAG_KINDS)
def test_a_drive_in_the_small_world(small_version, small_scans, tmp_path: Path, kind: str):
    stores, localizer = stores_of(kind), Localizer(MapIndex.load(small_version.directory))
    mounted = ros_samples.transforms([("base_link", "lidar", BASE_LIDAR)], stores=stores)
    messages: list[tuple[str, int, object]] = [("/tf_static", S, mounted)]
    for number, (scan, T_map_sensor) in enumerate(small_scans[:6]):
        up = 9.81 * T_map_sensor[2, :3]
        resting = ros_samples.imu(up, stores=stores, stamp_ns=(2 + number) * S, frame_id="lidar")
        messages.append(("/imu", (2 + number) * S, resting))
        cloud = cloud_of_points(scan.points, stores=stores, stamp_ns=(2 + number) * S, frame_id="lidar")
        messages.append(("/points", (2 + number) * S, cloud))
    wanted = Replay(write_bag(tmp_path, kind, messages), imu_topic="/imu", base_frame="base_link")
    asked: list[LocalizeOptions] = []

    def ask(scan, options):
        asked.append(options)
        return localizer.localize(scan, options)

    answers = [one.answer for one in replay(wanted, ask, LocalizeOptions())]
    assert all(options.gravity is not None for options in asked)
    localized = 0
    for answer, (_, T_map_sensor) in zip(answers, small_scans[:6], strict=True):
        if answer.verdict is Verdict.LOCALIZED:
            localized += 1
            off_m, off_deg = pose_error(T_map_sensor @ inverse(BASE_LIDAR), answer.T_map_base)
            assert off_m < 0.1
            assert off_deg < 1
    assert localized >= 4


BASE_FRONT = from_quaternion([0.35, 0.1, 0.7], [0, 0, 0.2, 0.98])
BASE_REAR = from_quaternion([-0.3, -0.1, 0.55], [0.0, 0.05, 0.97, 0.2])
MERGED_KIND = "mcap zstd message"


def quarter_view(world: Simulator, T_map_sensor: np.ndarray, seed: int) -> np.ndarray:
    """Points, in its frame, of a sensor that sees 45 degrees to each side."""
    azimuth = np.radians(np.arange(-45, 45, 0.6))
    elevation = np.radians(np.linspace(-15, 15, 16))
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(azimuth, elevation))
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    ranges = world.cast(np.broadcast_to(T_map_sensor[:3, 3], rays.shape), rays @ T_map_sensor[:3, :3].T)
    hit = np.isfinite(ranges)
    noise = np.random.default_rng(seed).normal(0, 0.01, len(ranges))
    return rays[hit] * (ranges + noise)[hit, None]


def test_two_lidars_of_a_robot_that_drives(small_world, small_version, small_scans, tmp_path: Path):
    """Each sees a quarter of the world, from its own place and at its own time."""
    world = Simulator(small_world.vertices, small_world.triangles)
    localizer = Localizer(MapIndex.load(small_version.directory))
    drives = from_quaternion([0.06, 0.0, 0.0], [0, 0, 0.02, 1])  # in the 0.04 s between the clouds: 1.5 m/s
    mounted = [("base_link", "front", BASE_FRONT), ("base_link", "rear", BASE_REAR)]
    messages: list[tuple[str, int, object]] = [("/tf_static", S, ros_samples.transforms(mounted))]
    poses = []
    for number, (_, T_map_sensor) in enumerate(small_scans[:12]):
        T_map_base = T_map_sensor @ inverse(BASE_FRONT)
        poses.append(T_map_base)
        for name, at_ms, T_map_lidar in (
            ("front", 0, T_map_base @ BASE_FRONT),
            ("rear", 40, T_map_base @ drives @ BASE_REAR),
        ):
            stamp_ns = (2 + number) * S + at_ms * 10**6
            points = quarter_view(world, T_map_lidar, number)
            cloud = cloud_of_points(points, stamp_ns=stamp_ns, frame_id=name)
            messages.append((f"/{name}", stamp_ns + 10**7, cloud))
    path = write_bag(tmp_path, MERGED_KIND, messages)
    near = {}
    for topics in (("/front",), ("/front", "/rear")):
        wanted = Replay(path, topics, base_frame="base_link")
        answers = [one.answer for one in replay(wanted, localizer.localize, LocalizeOptions())]
        off_m = [
            pose_error(T_map_base, answer.T_map_base)[0]
            for answer, T_map_base in zip(answers, poses, strict=True)
            if answer.T_map_base is not None
        ]
        near[topics] = sum(metres < 0.1 for metres in off_m)
        print(topics, len(off_m), np.round(off_m, 3))
    alone, merged = near.values()
    assert merged >= 9
    assert merged > alone


@pytest.fixture(scope="module")
def hall_localizer(hall_directory: Path) -> Localizer:
    return Localizer(MapIndex.load(hall_directory))


# The pose of the bags' three scans, 60 to 62 of the mapping run, refined against its neighbours
HALL_POSES = np.array(
    [
        [-1.081196, 8.302844, -0.009475, 0.049651, -0.026023, 0.915869, -0.397545],
        [-1.296923, 8.203516, -0.085394, 0.000150, -0.031477, 0.925317, -0.377886],
        [-1.371599, 8.185352, -0.112743, -0.022898, -0.021734, 0.935970, -0.350661],
    ]
)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["ros1.bag", "ros2_mcap", "ros2_sqlite3"])
def test_the_real_bags_localize_in_the_hall(hall_localizer: Localizer, ending: str):
    path = SHARED / "formats" / "converted" / f"hall_3scans_pointcloud2.{ending}"
    answers = [one.answer for one in replay(Replay(path), hall_localizer.localize, LocalizeOptions())]
    assert [answer.verdict for answer in answers] == [Verdict.LOCALIZED] * 3
    for answer, reference in zip(answers, HALL_POSES, strict=True):
        off_m, off_deg = pose_error(from_quaternion(reference[:3], reference[3:]), answer.T_map_sensor)
        assert off_m < 0.05
        assert off_deg < 0.5
