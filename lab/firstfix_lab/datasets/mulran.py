"""MulRan (Kim et al., ICRA 2020): city streets, several drives each, Ouster OS1-64 on a car.

KAIST01/Ouster/1561000444390857630.bin     time in nanoseconds; float32 x y z intensity
KAIST01/global_pose.csv                    time in nanoseconds, and the 12 numbers of T_utm_base
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.formats.raw_xyz import decode_xyzi
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.sources.read_map.file_errors import naming
from firstfix_builder.sources.read_map.rigid import rigid_matrices

from .ground_truth import GroundTruth, check_stamps, read_rows
from .recording import Recording
from .scan_files import ScanFiles, content_of, files_by_stamp, first_file

# calib_base2ouster.txt of the data set; its roll and pitch are below 0.001 degrees.
T_BASE_SENSOR = make_transform(rotation_z(np.radians(179.6654)), [1.7042, -0.021, 1.8047])


def open_mulran(path: Path) -> Recording:
    """Open the folder of a drive, such as ``KAIST01``.

    Raises:
        NotFound: it lacks scans or ground truth.
        MalformedData, TooLarge: the ground truth is damaged.
    """
    truth_file = first_file(path / "global_pose.csv")
    rows = read_rows(truth_file, 13, delimiter=",")
    with naming(truth_file):
        poses = rigid_matrices(rows[:, 1:].reshape(-1, 3, 4))
        check_stamps(rows[:, 0])
    truth = GroundTruth.of(truth_file, rows[:, 0].astype(np.int64), poses)
    return ScanFiles(files_by_stamp(path / "Ouster", "*.bin", int), truth, T_BASE_SENSOR, _read_scan)


def _read_scan(path: Path) -> Scan:
    cloud = decode_xyzi(content_of(path), SCAN_LIMITS)
    return Scan.from_points(cloud.xyz, cloud.intensity)
