"""NCLT (Carlevaris-Bianco et al., IJRR 2016): a campus, 27 sessions, Velodyne HDL-32E on a Segway.

    2012-01-08/velodyne_sync/1326030978134421.bin      time in microseconds
    2012-01-08/groundtruth_2012-01-08.csv              or ground_truth/ beside the session's folder

The frames of the data set have x forward (north), y right (east) and z down. Here both are turned to REP-103:
x forward (north), y left (west), z up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform
from firstfix_builder.sources.read_map.file_errors import naming
from firstfix_builder.sources.read_map.rigid import rigid_from_angles

from .ground_truth import GroundTruth, check_stamps, read_rows
from .recording import Recording
from .scan_files import ScanFiles, content_of, files_by_stamp, first_file

_US = 1_000
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # y and z
# Of the data set's paper, turned by FLIP. The points of velodyne_sync are in the body's frame and its axes.
SENSOR_IN_BODY_M = np.array([0.002, 0.004, 0.957], np.float32)


def open_nclt(path: Path) -> Recording:
    """Open the folder of a session, such as ``2012-01-08``.

    Raises:
        NotFound: it lacks scans or ground truth.
        MalformedData, TooLarge: the ground truth is damaged.
    """
    session = path.resolve()
    name = f"groundtruth_{session.name}.csv"
    truth_file = first_file(session / name, session.parent / "ground_truth" / name, session.parent / name)
    rows = read_rows(truth_file, 7, delimiter=",")
    rows = rows[np.isfinite(rows).all(axis=1)]  # the data set has no pose at some times
    with naming(truth_file):
        poses = FLIP @ rigid_from_angles(rows[:, 1:4], rows[:, 4:]) @ FLIP
        check_stamps(rows[:, 0] * _US)
    truth = GroundTruth.of(truth_file, (rows[:, 0] * _US).astype(np.int64), poses)
    files = files_by_stamp(session / "velodyne_sync", "*.bin", lambda stem: int(stem) * _US)
    return ScanFiles(files, truth, make_transform(np.eye(3), SENSOR_IN_BODY_M), _read_scan)


def _read_scan(path: Path) -> Scan:
    """Read the points, as seen from the sensor. The decoder turns their axes."""
    cloud = decode_scanner_bin(content_of(path), "velodyne_sync.bin", SCAN_LIMITS)
    return Scan.from_points(cloud.xyz - SENSOR_IN_BODY_M, cloud.intensity)
