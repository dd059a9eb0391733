"""Localizes a robot at start: sends one scan after the other until one is localized.

    python robot_startup.py --url http://service:8080 --map hall --imu 0.1,-0.2,9.8 SCAN...

Exit codes: 0 localized, prints the pose; 1 no answer; 3 the last scan fits several places; 4 it fits none.
"""

import argparse
import sys

import numpy as np
from recorded_drive import pose_text

from firstfix.errors import FirstfixError
from firstfix_client import Client, ServiceUnreachable, Verdict

EXIT = {Verdict.LOCALIZED: 0, Verdict.AMBIGUOUS: 3, Verdict.REJECTED: 4}

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("--imu", help="accelerometer at rest: x,y,z in the axes of the LiDAR")
parser.add_argument("scans", nargs="+", help="scan files; on a robot, the driver's next scans")
given = parser.parse_args()

gravity = None  # the service finds it from floors and walls in the scan
if given.imu:
    # An accelerometer at rest measures the force that holds the robot up. Gravity points the other way.
    gravity = -np.array([float(number) for number in given.imu.split(",")])

with Client(given.url, timeout_s=5) as client:
    for scan in given.scans:
        try:
            # compact: sends under 10 KB. Points (n, 3) in metres can be used instead of a file.
            fix = client.localize(scan, map_id=given.map, gravity=gravity, encoding="compact")
        except (FirstfixError, ServiceUnreachable) as error:  # after retries for five seconds
            sys.exit(f"no answer: {error}")
        if fix.verdict is Verdict.LOCALIZED:
            print(f"localized: {pose_text(fix.T_map_sensor)}, probability {fix.probability:.3f}")
            break
        # Never drive by a pose that is not localized. Another view helps: turn on the spot, drive a metre, or
        # wait for people to pass. The hypotheses are hints for a person.
        why = ", ".join(reason.value for reason in fix.reasons)
        print(f"{fix.verdict.value} ({why}): {len(fix.hypotheses)} places fit; turning for another view")
    else:
        print("no fix: try several_scans.py, or ask a person")

sys.exit(EXIT[fix.verdict])
