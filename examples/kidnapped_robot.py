"""A robot that drives by odometry checks where it is, notices that it was carried off, finds itself again.

    python kidnapped_robot.py --url http://service:8080 --map hall DRIVE.csv

DRIVE.csv has the poses by odometry, which knows nothing of being carried. Ends with 0 if the robot knows
where it is, else with 3.
"""

import argparse
import sys

import numpy as np
from recorded_drive import read_drive, told

from firstfix_client import Client, Prior, ScanSequence, Verdict

RADIUS_M = 1.0  # more than odometry drifts from one check to the next
TOGETHER = 4  # scans at most in one query

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("drive", help="CSV of scans and odometry")
given = parser.parse_args()

T_map_odom = None  # what AMCL would publish; None: the robot does not know where it is
doubtful = []  # (scan, T_odom_sensor) since it was last seen where odometry says
with Client(given.url) as client:
    for number, (scan, T_odom_sensor) in enumerate(read_drive(given.drive)):
        if T_map_odom is not None:
            expected = T_map_odom @ T_odom_sensor
            fix = client.localize(scan, map_id=given.map, prior=Prior(expected[:3, 3], RADIUS_M))
            if fix.verdict is Verdict.LOCALIZED:
                T_map_odom, doubtful = fix.T_map_sensor @ np.linalg.inv(T_odom_sensor), []
                print(f"scan {number}: still on the way, {told(fix.T_map_sensor)}")
                continue
        # Not where it should be, or nobody knows where that is. One bad scan is no proof, and what was seen
        # since tells more than one scan does: all of it is asked, with no word on where the robot should be.
        # Scans from before it was carried and after it fit nowhere together; they soon leave the window.
        doubtful = [*doubtful, (scan, T_odom_sensor)][-TOGETHER:]
        scans, poses = zip(*doubtful, strict=True)
        fix = client.localize(ScanSequence.along(scans, poses), map_id=given.map)
        if fix.verdict is not Verdict.LOCALIZED:
            print(f"scan {number}: {fix.verdict.value}; stopping until more scans say more")
            continue
        if T_map_odom is None:
            print(f"scan {number}: first fix, {told(fix.T_map_sensor)}")
        elif (away_m := np.linalg.norm((fix.T_map_sensor - expected)[:3, 3])) > RADIUS_M:
            print(f"scan {number}: carried off by {away_m:.1f} m, now at {told(fix.T_map_sensor)}")
        else:
            print(f"scan {number}: where it should be after all, {told(fix.T_map_sensor)}")
        T_map_odom, doubtful = fix.T_map_sensor @ np.linalg.inv(T_odom_sensor), []

sys.exit(0 if fix.verdict is Verdict.LOCALIZED else 3)
