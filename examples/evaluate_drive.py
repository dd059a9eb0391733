"""Measures accuracy on your robot: localizes every scan of a recorded drive with known poses.

    python evaluate_drive.py --url http://service:8080 --map hall POSES.csv

A scan without a pose was taken outside the map and must not be localized. The exit code is 1 if a scan was
localized at a wrong pose. ``firstfix evaluate`` does more, with pictures. ``firstfix localize --bag`` reads
ROS bags.
"""

import argparse
import sys
import time

import numpy as np
from recorded_drive import read_drive

from firstfix.transform import pose_error
from firstfix_client import Client, Verdict

NEAR_M, WRONG_M = 0.2, 1.0

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("poses", help="CSV of scans and true poses in the map frame")
given = parser.parse_args()

errors_m, claimed, right, took_s = [], [], [], []
wrong = inside = 0
with Client(given.url) as client:
    for scan, T_true in read_drive(given.poses):
        begun = time.monotonic()
        fix = client.localize(scan, map_id=given.map)
        took_s.append(time.monotonic() - begun)
        inside += T_true is not None
        # Calibration: is the first hypothesis right as often as its probability says? The verdict does not
        # matter.
        best = fix.hypotheses[0].T_map_sensor if fix.hypotheses else None
        off_m = np.inf if best is None or T_true is None else pose_error(T_true, best)[0]
        claimed.append(fix.probability)
        right.append(off_m <= NEAR_M)
        if fix.verdict is Verdict.LOCALIZED:
            errors_m.append(off_m)
            wrong += off_m > WRONG_M

within = sum(off_m <= NEAR_M for off_m in errors_m)
print(f"{len(claimed)} scans, {inside} of them in the map, {1e3 * np.median(took_s):.0f} ms at the median")
print(f"success: {within} of {inside} localized within {NEAR_M} m")
if errors_m:
    print(f"error: {100 * np.median(errors_m):.1f} cm at the median; {wrong} localized and wrong")
claimed, right = np.array(claimed), np.array(right)
for low, high in ((0.0, 0.5), (0.5, 0.995), (0.995, 1.01)):
    alike = (low <= claimed) & (claimed < high)
    if alike.any():
        said, was = claimed[alike].mean(), right[alike].mean()
        print(f"reliability: {alike.sum()} scans said {said:.2f}, {was:.2f} of them are right")
sys.exit(1 if wrong else 0)
