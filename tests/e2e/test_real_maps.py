"""Each real map from its file to a pose: a part or all of it is built, and a held-out scan is found there."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.decode import read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import Matrix, from_quaternion, pose_error
from firstfix_builder.pipeline import build_version
from firstfix_builder.sources.read_map import read_map, read_trajectory
from firstfix_cli.sample_world.write_world import pcd_of_points
from tests.needs import of_recordings
from tests.once_a_run import OnceARun
from tests.pose_rows import POSE, write_rows
from tests.recorded_data import DATASETS, HALL, Dataset

MAP_M, TRACK_M = 18.0, 7.0  # of the map and of the mapping run, round the place of the scan
FOUND_M, FOUND_DEG = 0.2, 2.0
LITTLE = {
    "viewpoints": {"spacing_m": 1.5, "max_distance_to_trajectory_m": 3.0},
    "learn_keys": {"scans": 0},
    "self_test": {"queries": 4, "outside": 2},
}
OURS = {dataset.name: dataset for dataset in DATASETS if not dataset.folder.startswith("koide")}


@pytest.mark.parametrize("name", OURS)
@pytest.mark.timeout(900)
def test_a_held_out_scan_finds_its_place(
    name: str, once_a_run: OnceARun, tmp_path: Path, request: pytest.FixtureRequest
):
    if not OURS[name].available:
        pytest.skip(of_recordings(OURS[name].folder))
    dataset = OURS[name].converted(tmp_path)
    scan, T_map_sensor = _first_query(dataset, tmp_path)
    if name == HALL.name:  # other tests ask all of it
        version = request.getfixturevalue("hall_directory")
    else:
        part = once_a_run.folder(
            f"real-{name}", lambda folder: _build_part(dataset, T_map_sensor[:3, 3], folder)
        )
        version = part / "version"
    found = Localizer(MapIndex.load(version)).localize(read_scan_file(scan))
    error_m, error_deg = pose_error(T_map_sensor, found.hypotheses[0].T_map_sensor)
    assert error_m < FOUND_M, found
    assert error_deg < FOUND_DEG, found


def _first_query(dataset: Dataset, folder: Path) -> tuple[Path, Matrix]:
    """The file of a held-out scan, and T_map_sensor."""
    with dataset.write_queries(folder / "queries.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    pose = [float(row[column]) for column in POSE]
    return Path(row["scan"]), from_quaternion(pose[:3], pose[3:])


def _build_part(dataset: Dataset, middle_m: NDArray[np.float64], folder: Path) -> None:
    """Builds what of the map lies round a place, from a file and with the poses of the run, as users do."""
    points = read_map(dataset.map_path).points
    part = folder / "part.pcd"
    part.write_bytes(pcd_of_points(points[_near(points, middle_m, MAP_M)]))
    whole = dataset.write_trajectory(folder / "whole.csv")
    assert whole is not None
    T_map_sensor = read_trajectory(whole)
    with whole.open() as file:
        rows = [line.split(",") for line in file.read().splitlines()[1:]]
    near = _near(T_map_sensor[:, :3, 3], middle_m, TRACK_M)
    track = write_rows(folder / "track.csv", POSE, [rows[number] for number in np.flatnonzero(near)])
    config = BuildConfig.parse({**dataset.config, **LITTLE})
    build_version(part, config, folder, trajectory=track)


def _near(
    positions: NDArray[np.float64], middle_m: NDArray[np.float64], within_m: float
) -> NDArray[np.bool_]:
    """(n,) which of (n, 3) positions are so near on the ground."""
    return np.linalg.norm(positions[:, :2] - middle_m[:2], axis=1) < within_m
