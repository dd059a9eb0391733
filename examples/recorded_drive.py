"""What a robot's LiDAR and odometry deliver, here from a CSV file: a line a scan, in the order of the drive.

Columns: scan (a file, from the CSV's folder), tx, ty, tz, qx, qy, qz, qw: the sensor's pose when it was
taken, in the odometry's frame or, where the truth is known, in the map's.
"""

import csv
from pathlib import Path

from firstfix.decode import read_scan_file
from firstfix.transform import from_quaternion


def read_drive(path):
    """Scan, and (4, 4) pose of the sensor or None where there is none, of each line.

    A driver's points become a scan by ``firstfix_client.Scan.from_points``, (n, 3) in metres.
    """
    drive = []
    with Path(path).open(newline="") as file:
        for row in csv.DictReader(file):
            numbers = [row[name] for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")]
            pose = [float(number) for number in numbers] if all(numbers) else None
            T = None if pose is None else from_quaternion(pose[:3], pose[3:])
            drive.append((read_scan_file(Path(path).parent / row["scan"]), T))
    return drive


def told(T_map_sensor):
    """A pose in words."""
    x, y, z = T_map_sensor[:3, 3]
    return f"x {x:.2f} y {y:.2f} z {z:.2f}"
