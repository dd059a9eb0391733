"""The sample worlds are what their README promises: the truth in them is true."""

from __future__ import annotations

import csv
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel
from firstfix.transform import from_quaternion, rotation_angle_deg, transform_points
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world import write_world
from firstfix_cli.sample_world.drive import drive
from firstfix_cli.sample_world.make_world import QUERIES, World
from firstfix_lab.worlds import NAMES, make_world
from firstfix_lab.worlds.make_world import place_of

pytestmark = pytest.mark.slow

made = cache(make_world)  # seconds each


@pytest.fixture(params=NAMES)
def world(request: pytest.FixtureRequest) -> World:
    return made(request.param)


def known(world: World) -> list[tuple[np.ndarray, np.ndarray]]:
    """(points, T_map_sensor) of the queries that are in the map."""
    return [(q.scan.points, q.T_map_sensor) for q in world.queries if q.T_map_sensor is not None]


def test_it_has_the_promised_shape(world: World) -> None:
    assert 10_000 < len(world.mesh.triangles) < 300_000
    assert world.mesh.triangles.min() == 0
    assert world.mesh.triangles.max() == len(world.mesh.vertices) - 1
    assert world.trajectory.shape == (len(world.trajectory), 4, 4)
    assert world.cloud.shape == (len(world.cloud), 3)
    assert len(known(world)) == QUERIES
    assert len(world.queries) == QUERIES + 4
    for query in world.queries:
        assert len(query.scan) > (10_000 if world.name == "farm" else 20_000)  # 16 beams, and much sky
        assert np.linalg.norm(query.scan.points, axis=1).max() < world.sensor.max_range_m + 0.2
    R = world.trajectory[:, :3, :3]
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(R), 1)


def test_the_robot_drives_smoothly_and_touches_nothing(world: World) -> None:
    position = world.trajectory[:, :3, 3]
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert step.max() < 1.3
    turns = [rotation_angle_deg(a[:3, :3].T @ b[:3, :3]) for a, b in pairwise(world.trajectory)]
    assert max(turns) < 100
    simulator = Simulator(world.mesh.vertices, world.mesh.triangles)
    assert simulator.distance(position).min() > 0.3
    below = simulator.cast(position, np.tile([0.0, 0.0, -1.0], (len(position), 1)))
    # stairs have steps; elsewhere the sensor keeps its mount height
    assert np.abs(below - world.sensor.mount_height_m).max() < 0.25
    assert np.median(np.abs(below - world.sensor.mount_height_m)) < 0.02


def test_the_cloud_lies_on_the_true_surfaces(world: World) -> None:
    simulator = Simulator(world.mesh.vertices, world.mesh.triangles)
    off = simulator.distance(world.cloud)
    assert np.median(off) < 0.03
    assert np.quantile(off, 0.99) < 0.15


def test_the_map_has_drifted_slowly_and_its_trajectory_with_it(world: World) -> None:
    place = place_of(world.name, world.seed)
    driven = drive(place)
    drift = world.trajectory[:, :3, 3] - driven[:, :3, 3]
    assert 0.01 < np.linalg.norm(drift, axis=1).max() < 0.035
    assert np.linalg.norm(np.diff(drift, axis=0), axis=1).max() < 0.005
    # scans fit the cloud better where the trajectory says they are than where they were
    simulator = Simulator(world.mesh.vertices, world.mesh.triangles)
    worst = np.argsort(np.linalg.norm(drift, axis=1))[-20:]
    sensor = world.sensor.coarser(4_000)
    tree, misfit = cKDTree(world.cloud), np.zeros(2)
    ranges = next(simulator.ranges(driven[worst], sensor))
    for k, row in zip(worst, ranges, strict=True):
        points = row[row < 15, None] * sensor.directions()[row < 15]
        misfit += [np.mean(tree.query(transform_points(T[k], points))[0]) for T in (world.trajectory, driven)]
    assert misfit[0] < misfit[1]


def test_queries_stand_free_and_beside_the_drive(world: World) -> None:
    positions = np.array([T[:3, 3] for _, T in known(world)])
    simulator = Simulator(world.mesh.vertices, world.mesh.triangles)
    assert simulator.distance(positions).min() > 0.3
    away, _ = cKDTree(world.trajectory[:, :3, 3]).query(positions)
    assert away.min() > 0.25
    assert away.max() < 2.0
    tilt = np.degrees([np.arccos(T[2, 2]) for _, T in known(world)])
    assert np.median(tilt) > 0.2
    assert tilt.max() < {"campus": 15, "farm": 25}.get(world.name, 2.1)
    yaw = np.array([np.arctan2(T[1, 0], T[0, 0]) for _, T in known(world)])
    assert np.ptp(yaw) > np.pi


def test_scans_fit_the_map_at_their_true_pose_and_not_beside_it(world: World) -> None:
    tree = cKDTree(world.cloud)
    for points, T in known(world):
        laid = transform_points(T, points[::5])
        distance, _ = tree.query(laid)
        assert (distance < 0.2).mean() > 0.7
    # the truth is the best pose: a fine grid cannot hide half a metre
    points, T = known(world)[0]
    aside = T.copy()
    aside[:2, 3] += 0.5
    close = [np.mean(tree.query(transform_points(pose, points[::5]))[0] < 0.1) for pose in (T, aside)]
    assert close[0] > close[1] + 0.1


def test_the_place_has_changed_since_it_was_mapped(world: World) -> None:
    """Some returns of the queries are from things that the map does not have."""
    tree = cKDTree(world.cloud)
    new = [np.mean(tree.query(transform_points(T, points[::5]))[0] > 0.35) for points, T in known(world)]
    assert np.max(new) > 0.01


def test_its_surfaces_are_the_same_every_time(world: World) -> None:
    again = place_of(world.name, world.seed).mesh()
    assert np.array_equal(world.mesh.vertices, again.vertices)
    assert np.array_equal(world.mesh.triangles, again.triangles)


@pytest.mark.parametrize("world", ["factory"], indirect=True)
def test_what_is_seen_in_it_is_the_same_every_time(world: World) -> None:
    """In one of them: what drives through it and scans it is the same in all."""
    again = make_world(world.name)
    assert np.array_equal(world.trajectory, again.trajectory)
    assert np.array_equal(world.cloud, again.cloud)
    for a, b in zip(world.queries, again.queries, strict=True):
        assert np.array_equal(a.scan.points, b.scan.points)
        assert (a.T_map_sensor is None) == (b.T_map_sensor is None)
        assert a.T_map_sensor is None or np.array_equal(a.T_map_sensor, b.T_map_sensor)


@pytest.mark.parametrize("name", NAMES)
def test_another_seed_is_anotherplace_of(name: str) -> None:
    one, other = place_of(name, 0).mesh(), place_of(name, 1).mesh()
    assert one.vertices.shape != other.vertices.shape or not np.allclose(one.vertices, other.vertices)


@pytest.mark.parametrize("world", ["office"], indirect=True)
def test_both_storeys_of_the_office_are_visited(world: World) -> None:
    driven, asked = world.trajectory[:, 2, 3], np.array([T[2, 3] for _, T in known(world)])
    for z in (driven, asked):
        assert (z < 1.5).sum() > 0.3 * len(z)
        assert (z > 4.0).sum() > 0.3 * len(z)
    assert ((driven > 1.5) & (driven < 4.0)).sum() > 10  # on the stair, not through the ceiling


@pytest.mark.parametrize("world", ["campus", "farm"], indirect=True)
def test_the_open_places_are_hilly(world: World) -> None:
    assert np.ptp(world.trajectory[:, 2, 3]) > 2
    assert np.degrees(np.arccos(world.trajectory[:, 2, 2].min())) > 2


def test_what_is_written_reads_back(world: World, tmp_path: Path) -> None:
    write_world(world, tmp_path)

    sensor = SensorModel.from_mapping(yaml.safe_load((tmp_path / "sensor.yaml").read_text()))
    assert sensor == world.sensor

    rows = np.loadtxt(tmp_path / "trajectory.txt")
    assert rows.shape == (len(world.trajectory), 8)
    assert (np.diff(rows[:, 0]) > 0).all()
    back = np.array([from_quaternion(row[1:4], row[4:]) for row in rows])
    assert np.allclose(back, world.trajectory, atol=1e-5)

    header, body = (tmp_path / "map.ply").read_bytes().split(b"end_header\n", 1)
    assert b"format binary_little_endian 1.0" in header
    assert np.array_equal(np.frombuffer(body, "<f4").reshape(-1, 3), world.cloud.astype(np.float32))

    _, body = (tmp_path / "mesh.ply").read_bytes().split(b"end_header\n", 1)
    edge = 12 * len(world.mesh.vertices)
    faces = np.frombuffer(body[edge:], np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    assert (faces["count"] == 3).all()
    assert np.array_equal(faces["corners"], world.mesh.triangles)

    with (tmp_path / "poses.csv").open() as file:
        poses = list(csv.DictReader(file))
    assert len(poses) == len(world.queries)
    for row, query in zip(poses, world.queries, strict=True):
        data = (tmp_path / row["scan"]).read_bytes().split(b"DATA binary\n", 1)[1]
        assert np.array_equal(np.frombuffer(data, "<f4").reshape(-1, 3), query.scan.points)
        numbers = [row[key] for key in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")]
        if query.T_map_sensor is None:
            assert numbers == [""] * 7
        else:
            pose = from_quaternion(*np.split(np.array(numbers, float), [3]))
            assert np.allclose(pose, query.T_map_sensor, atol=1e-5)
    assert f"seed {world.seed}" in (tmp_path / "README.txt").read_text()


def test_an_unknown_world_is_refused() -> None:
    with pytest.raises(InvalidOption, match="atlantis"):
        make_world("atlantis")
    with pytest.raises(InvalidOption, match="seed"):
        make_world("factory", seed=-1)
