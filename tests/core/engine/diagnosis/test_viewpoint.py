"""One viewpoint: right scans pass, also those of several LiDARs or revolutions; shifted scans do not."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.diagnosis.facts import MEASURED
from firstfix.engine.diagnosis.viewpoint import (
    AWAY_M,
    ELSEWHERE,
    ELSEWHERE_DESPITE_POSE,
    Viewpoint,
    best_viewpoint,
    is_elsewhere,
    is_even,
    is_suspect,
)
from firstfix.scan.reduction import at_most
from firstfix.scan_file import read_scan_file
from firstfix.sensor import SensorModel, preset
from firstfix.transform import from_quaternion, make_transform, rotation_z
from firstfix_builder.simulation.simulate import Simulator
from tests.every_case import every_case
from tests.needs import RECORDED, of_recordings
from tests.recorded_data import GARAGE, HALL, STREET, STREET_128, YARD, Dataset
from tests.small_world import SmallWorld, yard
from tests.storey_world import storey

Points = NDArray[np.float32]
AT_ORIGIN = np.eye(4)
AT_A_PLACE = make_transform(np.eye(3), [7.0, 3.0, 1.0])
TRUCK = "two on a truck, in its middle"  # which no room of the storey has place for
LIDARS = {  # positions on the robot, of which the first is the scan's frame
    "two on a robot": ([0.0, 0.0, 0.0], [-0.8, 0.4, 0.0]),
    TRUCK: ([2.0, 0.9, 0.0], [-2.0, -0.9, 0.0]),
    "three": ([0.0, 0.0, 0.0], [-1.0, 0.5, 0.0], [-1.0, -0.5, 0.2]),
}
REVOLUTIONS, REVOLUTION_S, SPEED_M_S, TURN_RAD_S = 10, 0.1, 1.5, 0.6


def office() -> SmallWorld:
    """A large room and shelves: more than a LiDAR sees from one place."""
    import trimesh

    boxes = [trimesh.creation.box((30, 24, 0.2)), trimesh.creation.box((30, 24, 0.2))]
    boxes[0].apply_translation((0, 0, -0.1))
    boxes[1].apply_translation((0, 0, 4.1))
    for x, y, w, d in ((-15, 0, 0.2, 24), (15, 0, 0.2, 24), (0, -12, 30, 0.2), (0, 12, 30, 0.2)):
        boxes.append(trimesh.creation.box((w, d, 4)))
        boxes[-1].apply_translation((x, y, 2))
    for x in (-10, -5, 5, 10):
        boxes.append(trimesh.creation.box((1.0, 9.0, 2.2)))
        boxes[-1].apply_translation((x, 4.0, 1.1))
    mesh = trimesh.util.concatenate(boxes)
    return SmallWorld(mesh.vertices, mesh.faces)


PLACES = {  # world, sensor, where it stands, x and y
    "yard": (yard, "vlp-16", [(-2.0, 0.5), (2.0, -1.0)]),
    "storey": (storey, "vlp-16", [(0.0, 0.3), (9.0, -0.2), (15.0, 3.6)]),
    "large room": (office, "os0-64", [(0.0, 0.0), (-7.5, -6.0), (12.0, 8.0)]),
}


def seen(simulator: Simulator, sensor: SensorModel, T_map_sensor: NDArray[np.float64]) -> Points:
    """The returns of one LiDAR, in its own frame."""
    rays = sensor.directions()
    towards = rays @ T_map_sensor[:3, :3].T.astype(np.float32)
    start = np.broadcast_to(T_map_sensor[:3, 3].astype(np.float32), towards.shape)
    range_m = simulator.cast(np.ascontiguousarray(start), np.ascontiguousarray(towards))
    hit = np.isfinite(range_m) & (range_m < sensor.max_range_m) & (range_m > 0.5)
    return rays[hit] * range_m[hit, None]


def placed(name: str) -> Iterator[tuple[Simulator, SensorModel, NDArray[np.float64]]]:
    make, sensor, spots = PLACES[name]
    world = make()
    simulator = Simulator(world.vertices, world.triangles)
    for number, (x, y) in enumerate(spots):
        yield simulator, preset(sensor), make_transform(rotation_z(0.7 * number), [x, y, 1.2])


def moved(points: Points, T: NDArray[np.float64]) -> Points:
    return (points @ T[:3, :3].T + T[:3, 3]).astype(np.float32)


def several_lidars(name: str, lidars: str) -> Iterator[Points]:
    for simulator, sensor, T_map_robot in placed(name):
        mounts = [make_transform(np.eye(3), at) for at in LIDARS[lidars]]
        yield np.concatenate([moved(seen(simulator, sensor, T_map_robot @ T), T) for T in mounts])


def a_second(name: str) -> Iterator[Points]:
    """Ten revolutions of a robot that drives, deskewed into the frame of the last one."""
    for simulator, sensor, T_map_last in placed(name):
        before_s = REVOLUTION_S * np.arange(REVOLUTIONS)
        steps = [
            make_transform(rotation_z(-TURN_RAD_S * time_s), [-SPEED_M_S * time_s, 0.0, 0.0])
            for time_s in before_s
        ]
        yield np.concatenate([moved(seen(simulator, sensor, T_map_last @ T), T) for T in steps])


def is_refused(points: Points, T_map_sensor: NDArray[np.float64] | None = None) -> bool:
    return is_elsewhere(best_viewpoint(points), T_map_sensor)


@pytest.mark.parametrize("name", PLACES)
def test_scans_of_one_robot_pass(name: str):
    for simulator, sensor, T in placed(name):
        assert not is_refused(seen(simulator, sensor, T), AT_ORIGIN)
    for lidars in LIDARS:
        if (name, lidars) != ("storey", TRUCK):
            assert not any(is_refused(points, AT_ORIGIN) for points in several_lidars(name, lidars)), lidars
    assert not any(is_refused(points, AT_ORIGIN) for points in a_second(name))


@pytest.mark.parametrize("name", PLACES)
def test_shifted_scans_are_refused_and_their_viewpoint_is_named(name: str):
    for simulator, sensor, T in placed(name):
        points = seen(simulator, sensor, T)
        for offset_m in ([8.0, 0.0, 0.0], [-5.0, 7.0, 0.0]):
            shifted = points + np.float32(offset_m)
            viewpoint = best_viewpoint(shifted)
            assert is_elsewhere(viewpoint, None)
            assert is_suspect(at_most(shifted, MEASURED))
            assert np.linalg.norm(viewpoint.position_m - offset_m) < 2.5
        at_the_maps_origin = points + np.float32([5.0, 0.0, 0.0])
        assert is_refused(at_the_maps_origin, AT_ORIGIN)


WIDTHS_DEG = (180, 120, 90, 60)
ROUND = ("vlp-16", "os1-64", "pandar64")  # with rings far apart, near each other, and both


def part_of_turn(points: Points, width_deg: float, heading_deg: float) -> Points:
    off_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0])) - heading_deg
    return points[np.abs((off_deg + 180) % 360 - 180) < width_deg / 2]


@pytest.mark.parametrize("name", PLACES)
def test_parts_of_a_turn_pass_and_shifted_ones_are_mostly_refused(name: str):
    make, _, spots = PLACES[name]
    simulator = Simulator(make().vertices, make().triangles)
    shifted = []
    for number, sensor in enumerate(ROUND):
        x, y = spots[number % len(spots)]
        T_map_sensor = make_transform(rotation_z(0.7 * number), [x, y, 1.2])
        points = seen(simulator, preset(sensor), T_map_sensor)
        for width_deg in WIDTHS_DEG:
            for heading_deg in (0, 135):
                part = part_of_turn(points, width_deg, heading_deg)
                assert not is_refused(part, AT_A_PLACE), (sensor, width_deg, heading_deg)
                assert not is_refused(part), (sensor, width_deg, heading_deg)
                shifted.append(is_refused(part + np.float32([8.0, -6.0, 0.0])))
    assert np.mean(shifted) > 0.5


def test_a_pose_is_turned_away_by_more_evidence_only():
    for evidence in (ELSEWHERE, ELSEWHERE_DESPITE_POSE):
        for off, refused in ((-0.05, False), (0.05, True)):
            viewpoint = Viewpoint(np.array([AWAY_M + 1, 0, 0]), 4.0, (evidence + off) / 4.0, 0.5)
            is_free = evidence == ELSEWHERE
            assert is_elsewhere(viewpoint, None if is_free else AT_A_PLACE) == refused
            assert is_elsewhere(viewpoint, AT_ORIGIN) == (refused or not is_free)
    near = Viewpoint(np.array([AWAY_M - 0.1, 0, 0]), 4.0, 1.0, 4.0)
    assert not is_elsewhere(near, None)


def test_a_map_is_even_and_a_scan_is_not():
    import trimesh

    world = office()
    mesh = trimesh.Trimesh(world.vertices, world.triangles, process=False)
    whole, _ = trimesh.sample.sample_surface(mesh, 250_000, seed=1)
    assert is_even(whole.astype(np.float32))
    assert not any(is_even(points) for points in a_second("large room"))


REAL = (HALL, STREET, YARD, GARAGE, STREET_128)


def held_out(place: Dataset, folder: Path) -> list[tuple[Points, NDArray[np.float64]]]:
    if not place.available:
        pytest.skip(of_recordings(place.folder))
    with place.write_queries(folder / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    poses = [[float(row[name]) for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")] for row in rows]
    return [
        (read_scan_file(Path(row["scan"])).points, from_quaternion(pose[:3], pose[3:]))
        for row, pose in zip(rows, poses, strict=True)
    ]


@every_case("place", REAL, ids=[place.name for place in REAL])
def test_real_scans_pass_and_those_in_the_maps_frame_do_not(place: Dataset, tmp_path: Path):
    scans = held_out(place, tmp_path)
    # a suspect costs a search of some milliseconds
    assert sum(is_suspect(at_most(within(points), MEASURED)) for points, _ in scans) <= len(scans) / 10
    for points, T in scans:
        assert not is_refused(within(points), AT_ORIGIN)
        near = within(moved(points, T))
        if np.linalg.norm(T[:3, 3]) > 7 and len(near) > len(points) / 2:
            assert is_refused(near, AT_ORIGIN)
    merged = [moved(points, np.linalg.inv(scans[0][1]) @ T) for points, T in scans[:2]]
    if place is HALL:  # the robot stood nearly still: two revolutions, or two LiDARs
        assert not is_refused(np.concatenate(merged), AT_ORIGIN)


def within(points: Points, range_m: float = 100.0) -> Points:
    return points[np.linalg.norm(points, axis=1) < range_m]


def test_strangers_and_turning_robots_pass():
    files = [*sorted(RECORDED.glob("strangers/*.pcd")), *sorted(RECORDED.glob("rotation_in_place_11/*.pcd"))]
    if not files:
        pytest.skip(of_recordings("strangers"))
    assert not [path.name for path in files if is_refused(within(read_scan_file(path).points))]
    raw = RECORDED.glob("motion_os1/*w*_0*.bin")
    scans = {path.name: np.fromfile(path, "<f4").reshape(-1, 3) for path in raw}
    assert not [name for name, points in scans.items() if is_refused(points)]
