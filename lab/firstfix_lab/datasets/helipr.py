"""HeLiPR (Jung et al., IJRR 2024): city streets, four LiDARs on a car, several drives each.

    KAIST04/LiDAR/Ouster/1689519045900126976.bin         time in nanoseconds; packed records, see ``RECORDS``
    KAIST04/LiDAR_GT/global_Ouster_gt.txt                time in nanoseconds, x y z qx qy qz qw of the sensor

The folders may also stand without ``LiDAR`` and ``LiDAR_GT``. Only the poses of ``global_*`` files are in one
frame for all drives: a map of one drive and scans of another need them.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from firstfix.errors import InvalidOption, MalformedData, NotFound
from firstfix.formats.point_cloud import SCAN_LIMITS, PointCloud
from firstfix.scan.scan import Scan
from firstfix.scan_file import scan_of_cloud
from firstfix_builder.sources.read_map.file_errors import naming
from firstfix_builder.sources.read_map.rigid import rigid_from_quaternions

from .ground_truth import GroundTruth, check_stamps, read_rows
from .recording import Recording
from .scan_files import ScanFiles, content_of, files_by_stamp, first_file

_XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
_AEVA = [*_XYZ, ("reflectivity", "<f4"), ("velocity", "<f4"), ("time_ns", "<i4"), ("line", "u1")]
# As the data set's own tools read them.
RECORDS = {
    "Aeva": np.dtype([*_AEVA, ("intensity", "<f4")]),
    "Avia": np.dtype([*_XYZ, ("intensity", "u1"), ("tag", "u1"), ("line", "u1"), ("time_ns", "<u4")]),
    "Ouster": np.dtype(
        [*_XYZ, ("intensity", "<f4"), ("time_ns", "<u4"), ("reflectivity", "<u2"), ("ring", "<u2")]
        + [("ambient", "<u2")]
    ),
    "Velodyne": np.dtype([*_XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("time_s", "<f4")]),
}
AEVA_WITHOUT_INTENSITY = np.dtype(_AEVA)
_LAST_WITHOUT_INTENSITY_NS = 1691936557946849179


def open_helipr(path: Path, lidar: str | None = None) -> Recording:
    """Open the folder of a drive, such as ``KAIST04``.

    Args:
        lidar: one of RECORDS; None: the only one with scans.

    Raises:
        InvalidOption: no such LiDAR, or several have scans and none is chosen.
        NotFound: it lacks scans or ground truth.
        MalformedData, TooLarge: the ground truth is damaged.
    """
    scans = path / "LiDAR" if (path / "LiDAR").is_dir() else path
    lidar = _chosen(scans, lidar)
    names = (f"global_{lidar}_gt.txt", f"{lidar}_gt.txt")
    truth_file = first_file(*(folder / name for name in names for folder in (path / "LiDAR_GT", path)))
    rows = read_rows(truth_file, 8, delimiter=None)
    with naming(truth_file):
        poses = rigid_from_quaternions(rows[:, 1:4], rows[:, 4:])
        check_stamps(rows[:, 0])
    truth = GroundTruth.of(truth_file, rows[:, 0].astype(np.int64), poses)
    files = files_by_stamp(scans / lidar, "*.bin", int)
    return ScanFiles(files, truth, np.eye(4), partial(_read_scan, lidar))


def _chosen(scans: Path, lidar: str | None) -> str:
    if lidar is not None:
        by_name = {name.lower(): name for name in RECORDS}
        if lidar.lower() not in by_name:
            raise InvalidOption(f"HeLiPR has no LiDAR {lidar!r}; it has {', '.join(RECORDS)}")
        return by_name[lidar.lower()]
    there = [name for name in RECORDS if (scans / name).is_dir()]
    if not there:
        raise NotFound(f"{scans}: no folder {', '.join(RECORDS)}")
    if len(there) > 1:
        raise InvalidOption(f"{scans} has scans of several LiDARs, choose one: --lidar {'|'.join(there)}")
    return there[0]


def _read_scan(lidar: str, path: Path) -> Scan:
    record = RECORDS[lidar]
    if lidar == "Aeva" and int(path.stem) <= _LAST_WITHOUT_INTENSITY_NS:
        record = AEVA_WITHOUT_INTENSITY
    body = content_of(path)
    if len(body) % record.itemsize or not body:
        raise MalformedData(f"HeLiPR {lidar}: {len(body)} bytes are not whole records of {record.itemsize}")
    rows = np.frombuffer(body, record)
    SCAN_LIMITS.check(f"HeLiPR {lidar}", len(rows), record.itemsize)
    return scan_of_cloud(PointCloud({name: rows[name] for name in record.names or ()}))
