"""Checks the odometry of a robot, notices when the robot was carried away, and localizes it again.

    python kidnapped_robot.py --url http://service:8080 --map hall DRIVE.csv

DRIVE.csv has poses by odometry, which does not notice the carrying. Exit codes: 0 the robot is localized at
the end, 3 it is not.
"""

import argparse
import sys

import numpy as np
from recorded_drive import pose_text, read_drive

from firstfix_client import Client, Prior, ScanSequence, Verdict

RADIUS_M = 1.0  # larger than the drift of odometry between two checks
TOGETHER = 4  # limit on the scans in one query

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("drive", help="CSV of scans and odometry")
given = parser.parse_args()

T_map_odom = None  # as AMCL publishes it; None: the robot is not localized
doubtful = []  # (scan, T_odom_sensor) since odometry was last confirmed
with Client(given.url) as client:
    for number, (scan, T_odom_sensor) in enumerate(read_drive(given.drive)):
        if T_map_odom is not None:
            expected = T_map_odom @ T_odom_sensor
            fix = client.localize(scan, map_id=given.map, prior=Prior(expected[:3, 3], RADIUS_M))
            if fix.verdict is Verdict.LOCALIZED:
                T_map_odom, doubtful = fix.T_map_sensor @ np.linalg.inv(T_odom_sensor), []
                print(f"scan {number}: still on the way, {pose_text(fix.T_map_sensor)}")
                continue
        # The robot is not where odometry says, or not localized yet. One bad scan is no proof, so the query
        # has all scans since the last confirmed one, without a prior. Scans from before and after the
        # carrying do not fit together; the old ones soon leave the window.
        doubtful = [*doubtful, (scan, T_odom_sensor)][-TOGETHER:]
        scans, poses = zip(*doubtful, strict=True)
        fix = client.localize(ScanSequence.along(scans, poses), map_id=given.map)
        if fix.verdict is not Verdict.LOCALIZED:
            told = "stopping until more scans say more"
            if fix.hint is not None:  # a goal for the robot's planner: from there the places look different
                goal = pose_text(T_odom_sensor @ fix.hint.T_sensor_goal)
                told = f"drive {fix.hint.distance_m:.1f} m to {goal} of odometry for the next scan"
            print(f"scan {number}: {fix.verdict.value}; {told}")
            continue
        if T_map_odom is None:
            print(f"scan {number}: first fix, {pose_text(fix.T_map_sensor)}")
        elif (away_m := np.linalg.norm((fix.T_map_sensor - expected)[:3, 3])) > RADIUS_M:
            print(f"scan {number}: carried off by {away_m:.1f} m, now at {pose_text(fix.T_map_sensor)}")
        else:
            print(f"scan {number}: where it should be after all, {pose_text(fix.T_map_sensor)}")
        T_map_odom, doubtful = fix.T_map_sensor @ np.linalg.inv(T_odom_sensor), []

sys.exit(0 if fix.verdict is Verdict.LOCALIZED else 3)
