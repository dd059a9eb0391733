"""Real maps and scans, when they lie beside the checkout: adapted to what ``firstfix`` commands read."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix, from_quaternion

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Dataset:
    """One place: its map, and held-out scans.

    Attributes:
        folder: below ``shared/data``.
        map_file: in it.
        scan_name: of a query scan by its number, any ending.
        mapping_file: thinned scans of the mapping run by their number, integers.
        mapping_unit_m: of these.
        reference: prefix of the columns with a query's pose, refined against the map.
        recorded: of those with its pose as it was recorded.
        config: of the build.
    """

    name: str
    folder: str
    map_file: str
    scan_name: str
    mapping_file: str
    mapping_unit_m: float
    reference: str
    recorded: str
    config: dict[str, Any] = field(default_factory=dict)

    @property
    def path(self) -> Path:
        return SHARED / self.folder

    @property
    def map_path(self) -> Path:
        return self.path / self.map_file

    @property
    def available(self) -> bool:
        return self.map_path.exists()

    def write_trajectory(self, path: Path) -> Path:
        """The mapping run's poses, without the held-out ones, as the CSV that ``build`` reads."""
        rows = [row for row in self._rows() if row["split"] != "query"]
        return _write(path, POSE, [[row[column] for column in POSE] for row in rows])

    def write_queries(self, path: Path, recorded: bool = False) -> Path:
        """``poses.csv`` of the held-out scans that are there, for ``evaluate``.

        Args:
            recorded: the poses as the vehicle recorded them, in place of those refined against the map.
        """
        lines = []
        for row in self._rows():
            if row["split"] != "query":
                continue
            number = int(next(iter(row.values())))
            scans = sorted((self.path / "queries").glob(self.scan_name.format(number) + ".*"))
            prefix = self.recorded if recorded else self.reference
            if scans:
                lines.append([str(scans[0]), *(row[prefix + column] for column in POSE)])
        return _write(path, ("scan", *POSE), lines)

    def mapping_scans(self) -> list[tuple[NDArray[np.float64], Matrix]]:
        """Scans of the mapping run, (n, 3) in the sensor frame, and T_map_sensor."""
        rows = {int(next(iter(row.values()))): row for row in self._rows()}
        scans = []
        with np.load(self.path / self.mapping_file) as file:
            for number in file.files:
                pose = [float(rows[int(number)][column]) for column in POSE]
                scans.append((file[number] * self.mapping_unit_m, from_quaternion(pose[:3], pose[3:])))
        return scans

    def _rows(self) -> list[dict[str, str]]:
        with (self.path / "poses.csv").open(newline="") as file:
            return list(csv.DictReader(file))


STREET = Dataset(
    "street",
    "kitti_drive0027_street",
    "map_0.2m.laz",
    "key_frame_{:03d}",
    "map_keyframes_thin_cm_int16.npz",
    0.01,
    "icp_",
    "",
    {"sensor": "hdl-64e", "viewpoints": {"spacing_m": 1.0, "max_distance_to_trajectory_m": 5.0}},
)
HALL = Dataset(
    "hall",
    "hilti_hall_indoor",
    "map_0.05m.laz",
    "scan_{:03d}",
    "map_scans_thin_2mm_int16.npz",
    0.002,
    "",
    "orig_",
    {"sensor": "os0-64", "viewpoints": {"spacing_m": 1.0, "max_distance_to_trajectory_m": 5.0}},
)


def _write(path: Path, header: tuple[str, ...], rows: list[list[str]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path
