"""A robot wakes up: ask with scan after scan until there is a fix.

    python robot_startup.py --url http://service:8080 --map hall --imu 0.1,-0.2,9.8 SCAN...

Ends with 0 and the pose, with 3 if the last scan fits several places, with 4 if it fits none, with 1 if
nobody answers.
"""

import argparse
import sys

import numpy as np
from recorded_drive import told

from firstfix.errors import FirstfixError
from firstfix_client import Client, ServiceUnreachable, Verdict

EXIT = {Verdict.LOCALIZED: 0, Verdict.AMBIGUOUS: 3, Verdict.REJECTED: 4}

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("--imu", help="x,y,z of the accelerometer at rest, in the LiDAR's axes")
parser.add_argument("scans", nargs="+", help="your driver's next scan, and the next, and the next")
given = parser.parse_args()

gravity = None  # then it is found from the scan's own floors and walls
if given.imu:
    # An accelerometer at rest measures what holds the robot up: gravity points the other way.
    gravity = -np.array([float(number) for number in given.imu.split(",")])

with Client(given.url, timeout_s=5) as client:
    for scan in given.scans:
        try:
            # compact: under 10 KB over the air. Points (n, 3) in metres do as well as a file.
            fix = client.localize(scan, map_id=given.map, gravity=gravity, encoding="compact")
        except (FirstfixError, ServiceUnreachable) as error:  # it has tried for five seconds
            sys.exit(f"no answer: {error}")
        if fix.verdict is Verdict.LOCALIZED:
            print(f"localized: {told(fix.T_map_sensor)}, probability {fix.probability:.3f}")
            break
        # Never drive by a pose that is not localized. What helps is another view: turn on the spot, roll on
        # for a metre, wait for people to pass. The places that fit are a hint for whoever looks at it.
        why = ", ".join(reason.value for reason in fix.reasons)
        print(f"{fix.verdict.value} ({why}): {len(fix.hypotheses)} places fit; turning for another view")
    else:
        print("no fix: several_scans.py, or a person, may help")

sys.exit(EXIT[fix.verdict])
