"""A street with the trail of a car that drove along: the trail goes, and what stands stays."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import CleanConfig
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, quaternion_of, transform_points
from firstfix_builder.mesh.clean_cloud import voxel_means
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map.mapping_scans import MappingScans
from firstfix_builder.sources.read_map.posed_scans import POSES
from firstfix_builder.sources.read_map.scan_folders import FOLDER
from firstfix_builder.sources.read_map.without_moving import without_moving
from tests.builder.box_scenes import box, floor, walls

SENSOR = SensorModel("dense", tuple(np.linspace(-24, 16, 80).tolist()), 0.5, 0.5, 60.0, 1.8)
POLES = [box((x, 4.8, 0), (x + 0.12, 4.92, 4)) for x in np.arange(-8.0, 40, 6.0)]
FENCE = [box((x, -4.6, 0), (x + 0.04, -4.56, 1.2)) for x in np.arange(-10.0, 40, 0.25)]
STREET = [floor(-15, -8, 45, 8), *walls(-15, -8, 45, 8, 6.0), *POLES, *FENCE]
CAR = ((4.0, 1.4, 0.2), (8.2, 3.2, 1.6))  # seen from the first pose; as fast as the vehicle
WAY_M = np.arange(0.0, 30.0, 2.5)


def car(ahead_m: float) -> Mesh:
    return box(*((corner[0] + ahead_m, *corner[1:]) for corner in CAR))


def scan_at(x: float, *parts: Mesh) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    mesh = Mesh.joined([*STREET, *parts])
    rays = Rays.of_sensor(SENSOR)
    T = make_transform(np.eye(3), [x, 0.0, 1.8])
    (ranges,) = next(iter(Simulator(mesh.vertices, mesh.triangles).ranges(T[None], SENSOR, rays)))
    met = np.isfinite(ranges)
    return (rays.directions[met] * ranges[met, None]).astype(np.float32), T


def folder_of(
    path: Path, scans: list[tuple[NDArray[np.float32], NDArray[np.float64]]], shift_m: float = 0.0
) -> Path:
    (path / FOLDER).mkdir(parents=True)
    with (path / FOLDER / POSES).open("w") as file:
        rows = csv.writer(file)
        rows.writerow(["scan", "tx", "ty", "tz", "qx", "qy", "qz", "qw"])
        for number, (points, T) in enumerate(scans):
            np.save(path / FOLDER / f"{number}.npy", points)
            rows.writerow([f"{number}.npy", *(T[:3, 3] + [0, shift_m, 0]), *quaternion_of(T)])
    return path


@pytest.fixture(scope="module")
def driven() -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Scans along the street, each with the car at its place of that time."""
    return [scan_at(x, car(0.9 * x)) for x in WAY_M]


def cloud_of(scans: list[tuple[NDArray[np.float32], NDArray[np.float64]]]) -> NDArray[np.float64]:
    return voxel_means(np.concatenate([transform_points(T, p.astype(np.float64)) for p, T in scans]), 0.1)


def in_the_lane(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (points[:, 1] > 1.3) & (points[:, 1] < 3.3) & (points[:, 2] > 0.6) & (points[:, 2] < 1.7)


def test_the_trail_of_a_car_goes_and_what_stands_stays(tmp_path, driven):
    cloud = cloud_of(driven)
    scans = MappingScans(folder_of(tmp_path, driven), "z-up")
    stays, moving = without_moving(cloud, scans, np.eye(4), CleanConfig(most_passed=0.3))
    trail = in_the_lane(cloud)
    assert trail.mean() > 0.01
    assert stays[trail].mean() < 0.25
    assert stays[~trail & (np.abs(cloud[:, 1] - 2.3) > 1.5)].mean() > 0.999  # poles, fence, walls and ground
    assert moving.scans == len(driven)
    assert moving.left_out == pytest.approx(1 - stays.mean(), abs=1e-5)
    assert not moving.not_used


def test_nothing_goes_where_nothing_moved(tmp_path):
    scans = [scan_at(x) for x in WAY_M]
    cloud = cloud_of(scans)
    found = MappingScans(folder_of(tmp_path, scans), "z-up")
    stays, moving = without_moving(cloud, found, np.eye(4), CleanConfig())
    assert moving.left_out < 0.001
    assert stays.mean() > 0.999


def test_if_too_much_would_go_nothing_goes(tmp_path, driven):
    cloud = cloud_of(driven)
    scans = MappingScans(folder_of(tmp_path, driven), "z-up")
    stays, moving = without_moving(cloud, scans, np.eye(4), CleanConfig(most_passed=0.001))
    assert stays.all()
    assert moving.left_out == 0 < moving.passed


def test_poses_that_do_not_fit_are_not_used(tmp_path, driven):
    cloud = cloud_of(driven)
    scans = MappingScans(folder_of(tmp_path, driven, shift_m=3.0), "z-up")
    stays, moving = without_moving(cloud, scans, np.eye(4), CleanConfig())
    assert stays.all()
    assert moving.scans == 0
    assert set(moving.not_used.values()) == {"its pose does not fit the map"}


def test_scans_that_cannot_be_used_say_why(tmp_path, driven):
    folder = folder_of(tmp_path, driven[:4]) / FOLDER
    (folder / "0.npy").write_bytes(b"\x93NUMPY")
    (folder / "1.npy").unlink()
    rows = (folder / POSES).read_text().splitlines()
    rows[3] = "2.npy,1,2,3,0,0,0,0"
    (folder / POSES).write_text("\n".join([*rows, "../../secret.npy,0,0,9,0,0,0,1", "3.npy,,,,,,,"]) + "\n")
    _, moving = without_moving(cloud_of(driven), MappingScans(tmp_path, "z-up"), np.eye(4), CleanConfig())
    assert set(moving.not_used) == {"0.npy", "1.npy", "2.npy", "../../secret.npy", "3.npy"}
    assert str(tmp_path) not in str(moving.not_used)
    assert moving.scans == 1


@pytest.mark.parametrize("text", ["", "scan,tx\n", "\x00\n"])
def test_a_file_that_lists_no_poses_says_so(tmp_path, text: str):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / POSES).write_text(text)
    scans = MappingScans(tmp_path, "z-up")
    assert len(scans) == 0
    assert list(scans.left_out) == [POSES]


def test_a_map_without_scans_has_none(tmp_path):
    scans = MappingScans(tmp_path, "z-up")
    assert (len(scans), scans.left_out) == (0, {})
