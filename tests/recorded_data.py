"""Real maps and scans, when they lie beside the checkout: adapted to what ``firstfix`` commands read."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from firstfix.transform import Matrix, from_quaternion
from tests.koide_dataset import write_drawn_scans
from tests.pose_rows import POSE, write_rows
from tests.turning_robot import write_turning_robot

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@dataclass(frozen=True)
class PoseTable:
    """Poses of scans in a CSV file. The first column is the number or the file of the scan.

    Attributes:
        file: in the folder of the data set.
        prefix: of the columns ``tx,ty,tz,qx,qy,qz,qw``.
        splits: values of the column ``split`` of the rows that count; empty: all rows count.
    """

    file: str
    prefix: str = ""
    splits: tuple[str, ...] = ()

    def rows(self, folder: Path) -> list[tuple[str, list[str]]]:
        """Returns the first column and the seven numbers of a pose, row by row."""
        with (folder / self.file).open(newline="") as file:
            found = [row for row in csv.DictReader(file) if not self.splits or row["split"] in self.splits]
        return [(next(iter(row.values())), [row[self.prefix + name] for name in POSE]) for row in found]


@dataclass(frozen=True)
class Dataset:
    """One place: its map, and held-out scans.

    Attributes:
        folder: below ``root``.
        map_file: in it.
        scans: glob of the file of a query scan, by the first column of its row.
        references: true poses of the query scans by the name of their source. Scans are judged by the first.
        trajectory: poses of the mapping run, without the query scans; None: there are none.
        sensor: name of a preset, or a YAML file in the folder.
        viewpoints: config of the build's viewpoints.
        kept_share: of the points, in a scan made sparse at random; None: the points lie in rings, and every
            second ring is taken away.
        mapping_file: thinned scans of the mapping run by their number, integers; empty: there are none.
        mapping_unit_m: of these.
        convert: writes ``map_file``, the tables and the scans into a folder, from the folder as it is; None:
            nothing needs to be converted.
    """

    name: str
    folder: str
    map_file: str
    scans: str
    references: Mapping[str, PoseTable]
    trajectory: PoseTable | None
    sensor: str
    viewpoints: Mapping[str, Any] = field(default_factory=dict)
    kept_share: float | None = None
    mapping_file: str = ""
    mapping_unit_m: float = 1.0
    root: Path = SHARED
    convert: Callable[[Path, Path], None] | None = None

    @property
    def path(self) -> Path:
        return self.root / self.folder

    @property
    def map_path(self) -> Path:
        return self.path / self.map_file

    @property
    def available(self) -> bool:
        return self.path.exists()

    @property
    def config(self) -> dict[str, Any]:
        """Config of the build."""
        is_file = self.sensor.endswith(".yaml")
        sensor = yaml.safe_load((self.path / self.sensor).read_text()) if is_file else self.sensor
        return {"sensor": sensor, **({"viewpoints": dict(self.viewpoints)} if self.viewpoints else {})}

    def converted(self, work: Path) -> Dataset:
        """Returns the data set with all of its files, written below ``work`` if they need to be."""
        if self.convert is None:
            return self
        folder = work / self.name
        folder.mkdir(parents=True, exist_ok=True)
        self.convert(self.path, folder)
        return replace(self, root=work, folder=self.name, convert=None)

    def write_trajectory(self, path: Path) -> Path | None:
        """The mapping run's poses, without the held-out ones, as the CSV that ``build`` reads."""
        if self.trajectory is None:
            return None
        return write_rows(path, POSE, [pose for _, pose in self.trajectory.rows(self.path)])

    def write_queries(self, path: Path, reference: str | None = None) -> Path:
        """``poses.csv`` of the held-out scans that are there, for ``evaluate``.

        Args:
            reference: source of the true poses; None: the first.
        """
        table = self.references[reference or next(iter(self.references))]
        found = [
            (sorted(self.path.glob(self.scans.format(name))), pose) for name, pose in table.rows(self.path)
        ]
        rows = [[str(files[0]), *pose] for files, pose in found if files]
        return write_rows(path, ("scan", *POSE), rows)

    def mapping_scans(self) -> list[tuple[NDArray[np.float64], Matrix]]:
        """Scans of the mapping run, (n, 3) in the sensor frame, and T_map_sensor."""
        assert self.trajectory is not None
        poses = {int(name): [float(v) for v in pose] for name, pose in self.trajectory.rows(self.path)}
        scans = []
        with np.load(self.path / self.mapping_file) as file:
            for number in file.files:
                pose = poses[int(number)]
                scans.append((file[number] * self.mapping_unit_m, from_quaternion(pose[:3], pose[3:])))
        return scans


_QUERY, _MAP = ("query",), ("map", "map_thin")
_NEAR_THE_TRACK = {"spacing_m": 1.0, "max_distance_to_trajectory_m": 5.0}

STREET = Dataset(
    "street",
    "kitti_drive0027_street",
    "map_0.2m.laz",
    "queries/key_frame_{:0>3}.*",
    {"ICP": PoseTable("poses.csv", "icp_", _QUERY), "RTK": PoseTable("poses.csv", "", _QUERY)},
    PoseTable("poses.csv", splits=_MAP),
    "hdl-64e",
    _NEAR_THE_TRACK,
    mapping_file="map_keyframes_thin_cm_int16.npz",
    mapping_unit_m=0.01,
)
HALL = Dataset(
    "hall",
    "hilti_hall_indoor",
    "map_0.05m.laz",
    "queries/scan_{:0>3}.*",
    {"ICP": PoseTable("poses.csv", "", _QUERY), "odometry": PoseTable("poses.csv", "orig_", _QUERY)},
    PoseTable("poses.csv", splits=_MAP),
    "os0-64",
    _NEAR_THE_TRACK,
    mapping_file="map_scans_thin_2mm_int16.npz",
    mapping_unit_m=0.002,
)
YARD = Dataset(
    "yard",
    "yard_vlp16_thin",
    "map_0.1m.laz",
    "{}",
    {"ICP": PoseTable("eval.csv")},
    PoseTable("trajectory.csv"),
    "vlp-16",
    kept_share=0.5,
)
GARAGE = Dataset(
    "garage",
    "garage_sphere_scans",
    "map_0.05m.laz",
    "{}",
    {"ICP": PoseTable("eval.csv")},
    PoseTable("trajectory.csv"),
    "sensor.yaml",
    kept_share=0.1,
)
STREET_128 = Dataset(
    "street_128beam",
    "street_128beam",
    "map_0.1m.laz",
    "{}",
    {"ICP": PoseTable("eval.csv")},
    PoseTable("trajectory.csv"),
    "sensor.yaml",
    kept_share=0.25,
)
TURNING = Dataset(
    "turning",
    "rotation_in_place_11",
    "map.xyz",
    "{}",
    {"authors": PoseTable("eval.csv")},
    PoseTable("trajectory.csv"),
    "mid-360",
    {"spacing_m": 1.0, "max_distance_to_trajectory_m": 4.0},
    kept_share=0.25,
    convert=write_turning_robot,
)


def _koide(name: str) -> Dataset:
    """A map of Koide's Hard Point Cloud Localization Dataset; BENCHMARK.md says where to get it."""
    return Dataset(
        name,
        f"koide_hard/{name}",
        "map.ply",
        "{}",
        {"authors": PoseTable("eval.csv")},
        None,
        "sensor.yaml",
        kept_share=0.25,
        convert=write_drawn_scans,
    )


DATASETS = (STREET, HALL, YARD, GARAGE, STREET_128, TURNING, _koide("outdoor_hard"), _koide("outdoor_kidnap"))
