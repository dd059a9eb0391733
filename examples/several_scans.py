"""Rooms that look alike: one scan fits them all, a few scans with the way between them fit one.

    python several_scans.py --url http://service:8080 --map hall DRIVE.csv

DRIVE.csv has the poses by odometry, in any frame. Ends with 0 and the pose of the last scan, else with 3.
"""

import argparse
import sys

from recorded_drive import read_drive, told

from firstfix_client import Client, ScanSequence, Verdict

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--map", required=True)
parser.add_argument("drive", help="CSV of up to 16 scans and odometry")
given = parser.parse_args()

scans, T_odom_sensor = zip(*read_drive(given.drive), strict=True)

with Client(given.url) as client:
    for number, scan in enumerate(scans):
        alone = client.localize(scan, map_id=given.map, encoding="compact")
        print(f"scan {number} alone: {alone.verdict.value}")
        for place in alone.hypotheses if alone.verdict is Verdict.AMBIGUOUS else ():
            print(f"    maybe {told(place.T_map_sensor)}, probability {place.probability:.2f}")

    # Odometry may start anywhere: only the way from scan to scan is sent.
    together = client.localize(ScanSequence.along(scans, T_odom_sensor), map_id=given.map, encoding="compact")

if together.verdict is not Verdict.LOCALIZED:
    sys.exit(3)
print(f"together: localized, {told(together.T_map_sensor)}, probability {together.probability:.3f}")
