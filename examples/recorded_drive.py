"""Reader for a recorded drive: a CSV file with one line for each scan. It replaces LiDAR driver and odometry.

Columns: scan (file, relative to the CSV), tx, ty, tz, qx, qy, qz, qw. The pose is that of the sensor at the
time of the scan, in the odometry frame or, for a true pose, in the map frame.
"""

import csv
from pathlib import Path

from firstfix.scan_file import read_scan_file
from firstfix.transform import from_quaternion


def read_drive(path):
    """Returns scan and (4, 4) sensor pose of each line; the pose is None if the line has none.

    ``firstfix_client.Scan.from_points`` makes a scan from a driver's points, (n, 3) in metres.
    """
    drive = []
    with Path(path).open(newline="") as file:
        for row in csv.DictReader(file):
            numbers = [row[name] for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")]
            pose = [float(number) for number in numbers] if all(numbers) else None
            T = None if pose is None else from_quaternion(pose[:3], pose[3:])
            drive.append((read_scan_file(Path(path).parent / row["scan"]), T))
    return drive


def pose_text(T_map_sensor):
    """Returns the position as text."""
    x, y, z = T_map_sensor[:3, 3]
    return f"x {x:.2f} y {y:.2f} z {z:.2f}"
