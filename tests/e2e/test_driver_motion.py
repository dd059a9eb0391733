"""Motion against physics: a robot turns at 90 degrees a second, and each driver writes its cloud.

A wrong unit, sign or order of the times cannot pass: the last points would lie up to 9 degrees off, or 18.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.builds.config import PerturbConfig
from firstfix.decode import decode_query
from firstfix.formats.point_cloud import PointCloud
from firstfix.ros.media_types import POINT_CLOUD2
from firstfix.scan_file import scan_of_cloud
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, pose_error
from firstfix_builder.simulation.moving import Motion, Sweep, poses_along
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.driver_clouds import LAYOUTS, PERIOD_S
from tests.every_case import every_case
from tests.small_world import SENSOR

TURN_RAD_S = np.pi / 2
TWIST = (1.0, 0.2, 0.0, 0.0, 0.0, TURN_RAD_S)
MAX_M, MAX_DEG, MAX_RAD_S = 0.03, 0.5, 0.1


@pytest.fixture(scope="module")
def turning(small_world, localizer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, their times since the begin of the turn, and the sensor's pose then."""
    simulator = Simulator(small_world.vertices, small_world.triangles)
    still = PerturbConfig(occluders=0, unmapped=0, vanished=0)
    simulation = ScanSimulation(simulator, SensorModel.from_mapping(SENSOR), still)
    at = localizer.index.cascade.templates.position_m
    case = simulation.cases(at, 1.0, 3, np.random.default_rng(21))[2]
    scan = simulation.scan(case, Motion(TWIST, Sweep(PERIOD_S, stamp=0.0)))
    order = np.argsort(scan.time_s, kind="stable")
    return scan.points[order].astype(np.float64), scan.time_s[order].astype(np.float64), case.T_level_sensor


def pose_at(T_map_begin: np.ndarray, since_begin_s: float) -> np.ndarray:
    R, t = poses_along(TWIST, np.array([since_begin_s]))
    return T_map_begin @ make_transform(R[0], t[0])


def why_wrong(answer: Localization, T_map_stamp: np.ndarray) -> str | None:
    """The fault of an answer, or None. Times of the wrong sign give the pose, but not the motion."""
    if answer.verdict is not Verdict.LOCALIZED or answer.twist is None:
        return f"{answer.verdict} {answer.reasons} {answer.probability:.3f}"
    off_m, off_deg = pose_error(T_map_stamp, answer.T_map_sensor)
    off_rad_s = abs(answer.twist[5] - TURN_RAD_S)
    if off_m < MAX_M and off_deg < MAX_DEG and off_rad_s < MAX_RAD_S:
        return None
    return f"{off_m:.3f} m, {off_deg:.2f} degrees, {off_rad_s:.2f} rad/s off"


@every_case("driver", LAYOUTS)
def test_a_robot_that_turns_is_localized_by_each_drivers_cloud(localizer, turning, driver):
    layout = LAYOUTS[driver]
    points, since_begin_s, T_map_begin = turning
    scan = decode_query(layout.message(points, since_begin_s), POINT_CLOUD2)
    stamped_s = float(since_begin_s.min()) if layout.own_clock else layout.stamp_s
    assert why_wrong(localizer.localize(scan), pose_at(T_map_begin, stamped_s)) is None


def test_times_of_another_unit_sign_or_order_would_not_pass(localizer, turning):
    points, since_begin_s, T_map_begin = turning
    scan = decode_query(LAYOUTS["ouster"].message(points, since_begin_s), POINT_CLOUD2)
    right = scan.time_s
    shuffled = np.random.default_rng(0).permutation(right)
    wrong = {"none": None, "ms": right / 1000, "before": right - PERIOD_S, "sign": -right, "order": shuffled}
    for name, times in wrong.items():
        assert why_wrong(localizer.localize(replace(scan, time_s=times)), T_map_begin), name


IMPLAUSIBLE = {
    "a few at 3.6 s": lambda t: np.where(np.arange(len(t)) % 50 == 7, 3.6, t),
    "off by a ring": lambda t: t + (np.arange(len(t)) % 16) * 5e-3,
    "microseconds": lambda t: t * 1e6,
    "epoch in float32": lambda t: (1.73e9 + t).astype(np.float32),
    "epoch in float64": lambda t: 1.73e9 + t,
    "one number": lambda t: np.full(len(t), 0.5),
}


@every_case("case", IMPLAUSIBLE)
def test_a_robot_at_rest_is_localized_with_implausible_times(localizer, small_world, case):
    simulator = Simulator(small_world.vertices, small_world.triangles)
    still = PerturbConfig(occluders=0, unmapped=0, vanished=0)
    simulation = ScanSimulation(simulator, SensorModel.from_mapping(SENSOR), still)
    at = localizer.index.cascade.templates.position_m
    where = simulation.cases(at, 1.0, 3, np.random.default_rng(21))[2]
    points = simulation.scan(where, Motion((0.0,) * 6, Sweep(PERIOD_S, stamp=0.0))).points
    since_begin_s = Sweep(PERIOD_S, stamp=0.0).times(points).astype(np.float64)
    columns = dict(zip("xyz", points.T, strict=True))
    scan = scan_of_cloud(PointCloud({**columns, "time": IMPLAUSIBLE[case](since_begin_s)}))
    answer = localizer.localize(scan)
    assert answer.verdict is Verdict.LOCALIZED
    off_m, off_deg = pose_error(where.T_level_sensor, answer.T_map_sensor)
    assert off_m < MAX_M
    assert off_deg < MAX_DEG
