"""Recorded places as kernels meet them: a map's surface and its view, and scans of it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from firstfix.engine.config import PreprocessConfig, RegistrationConfig
from firstfix.engine.index import MapView
from firstfix.engine.preprocess import PreparedQuery, preprocess
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix, from_quaternion
from tests.needs import recorded

MAPS = {
    "hall": ("hilti_hall_indoor", "map_0.1m.binary.pcd", ("scan_044.pcd", "scan_124.pcd")),
    "street": ("kitti_drive0027_street", "map_0.2m.laz", ("key_frame_007.pcd", "key_frame_037.pcd")),
}
PART_M = 80.0  # of the map, around the first scan


@dataclass(frozen=True)
class RecordedPlace:
    """Part of a recorded map, and scans that the map does not contain.

    Attributes:
        recorded: the scans, each with its true pose in the map.
        scans: the same, prepared.
    """

    surface: MapSurface
    view: MapView
    recorded: list[tuple[Scan, Matrix]]
    scans: list[tuple[PreparedQuery, Matrix]]


@cache
def recorded_place(name: str) -> RecordedPlace:
    """A place of ``MAPS``; the test is skipped where the recordings are not there."""
    folder, map_file, scan_files = MAPS[name]
    here = recorded(folder)
    poses = _poses(here / "poses.csv")
    read = [(read_scan_file(here / "queries" / file), poses[_number(file)]) for file in scan_files]
    centre = read[0][1][:3, 3]
    points = _map_points(here / map_file)
    points = points[np.abs(points - centre)[:, :2].max(axis=1) < PART_M]
    viewers = np.array([T[:3, 3] for T in poses.values()])
    to_viewer = viewers[cKDTree(viewers).query(points)[1]] - points
    surface = Surface.around(points, to_viewer)
    return RecordedPlace(
        MapSurface.of(surface, RegistrationConfig()),
        MapView.of(points, 25.0),
        read,
        [(_prepared(scan), T) for scan, T in read],
    )


def _prepared(scan: Scan) -> PreparedQuery:
    prepared = preprocess(ScanSequence.single(scan), None, PreprocessConfig())
    assert prepared is not None
    return prepared


def _map_points(path: Path) -> np.ndarray:
    if path.suffix == ".laz":
        import laspy

        return np.asarray(laspy.read(path).xyz, np.float64)
    return read_scan_file(path).points.astype(np.float64)


def _poses(path: Path) -> dict[int, Matrix]:
    with path.open() as file:
        return {
            _number(next(iter(row.values()))): from_quaternion(
                [float(row[key]) for key in ("tx", "ty", "tz")],
                [float(row[key]) for key in ("qx", "qy", "qz", "qw")],
            )
            for row in csv.DictReader(file)
        }


def _number(name: str) -> int:
    return int("".join(letter for letter in name if letter.isdigit()))
