"""A trajectory that is turned or mirrored against its map is found, and a right one is not."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.sensor import preset
from firstfix.transform import rotation_z
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator, upright
from firstfix_builder.sources.check_map.turned_trajectory import check_turned
from firstfix_builder.sources.read_map import read_trajectory
from firstfix_builder.sources.read_map.map_file import read_map_file
from tests.builder.box_scenes import box, floor, walls
from tests.needs import of_recordings
from tests.recorded_data import STREET, YARD

SENSOR = preset("vlp-16").coarser(3000)
# A corridor of 40 m, with a room at one side of its first half.
CORRIDOR = Mesh.joined([floor(0, 0, 40, 12), *walls(0, 0, 40, 12), box((10, 3, 0), (40, 12, 3))])
WAY = np.concatenate(
    [
        np.column_stack([np.linspace(1, 39, 39), np.full(39, 1.5), np.full(39, 0.8)]),
        np.column_stack([np.full(8, 4.0), np.linspace(2, 10, 8), np.full(8, 0.8)]),
    ]
)


def posed(positions: np.ndarray) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    return poses


def turned(positions: np.ndarray, turn_deg: float, about: np.ndarray, mirrored: bool = False) -> np.ndarray:
    mirror = np.diag([1.0, -1.0 if mirrored else 1.0, 1.0])
    return (positions - about) @ (rotation_z(np.radians(turn_deg)) @ mirror).T + about


def code(points: np.ndarray, positions: np.ndarray, origin: np.ndarray | None = None) -> str | None:
    found = check_turned(points, posed(positions), np.zeros(3) if origin is None else origin)
    return None if found is None else found.code


@pytest.fixture(scope="module")
def mapped() -> np.ndarray:
    """Points of the corridor, scanned from the way."""
    rays = Rays.of_sensor(SENSOR).directions
    simulator, start, clouds = Simulator(CORRIDOR.vertices, CORRIDOR.triangles), 0, []
    for block in simulator.ranges(upright(WAY), SENSOR):
        for ranges, at in zip(block, WAY[start:], strict=False):
            met = np.isfinite(ranges)
            clouds.append(ranges[met, None] * rays[met] + at)
        start += len(block)
    return np.concatenate(clouds).astype(np.float64)


def test_a_right_trajectory_and_parts_of_it_fit(mapped: np.ndarray):
    for part in (WAY, WAY[:20], WAY[20:], WAY[:10]):
        assert code(mapped, part) is None


@pytest.mark.parametrize("turn_deg", [90, 180, 270])
def test_a_turned_trajectory_is_found(mapped: np.ndarray, turn_deg: float):
    about_its_middle = turned(WAY, turn_deg, WAY.mean(axis=0))
    found = check_turned(mapped, posed(about_its_middle), np.zeros(3))
    assert found is not None
    assert found.numbers["turn_deg"] == 360 - turn_deg
    assert code(mapped, turned(WAY, turn_deg, np.zeros(3))) == "trajectory_turned", "about the map's origin"
    far = np.array([200.0, -50.0, 0.0])
    moved = turned(WAY, turn_deg, far) - far
    assert code(mapped - far, moved, np.zeros(3)) == "trajectory_turned", "in a local frame"


def test_a_trajectory_with_x_and_y_exchanged_is_found(mapped: np.ndarray):
    found = check_turned(mapped, posed(WAY[:, [1, 0, 2]]), np.zeros(3))
    assert found is not None
    assert found.code == "trajectory_turned"
    assert "far better mirrored and turned by 90 degrees" in found.text


def test_a_few_poses_have_no_finding(mapped: np.ndarray):
    assert code(mapped, turned(WAY, 90, WAY.mean(axis=0))[:4]) is None
    assert code(mapped[:5], WAY) is None


@pytest.mark.parametrize("place", [STREET, YARD], ids=lambda one: one.name)
def test_a_real_trajectory_fits_its_map_and_turned_by_90_degrees_it_does_not(place, tmp_path):
    if not place.available:
        pytest.skip(of_recordings(place.folder))
    points = read_map_file(place.map_path).points
    positions = read_trajectory(place.write_trajectory(tmp_path / "poses.csv"))[:, :3, 3]
    assert code(points, positions) is None
    assert code(points, turned(positions, 90, positions.mean(axis=0))) == "trajectory_turned"
    assert code(points, turned(positions, 90, np.zeros(3))) == "trajectory_turned"
