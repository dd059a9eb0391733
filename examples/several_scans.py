"""Localizes several scans together: in rooms that look alike, one scan fits all of them, several fit one.

    python several_scans.py --url http://service:8080 --map hall DRIVE.csv

DRIVE.csv has poses by odometry, in any frame. Exit codes: 0 prints the pose of the last scan, 3 not
localized.
"""

import argparse
import sys

from recorded_drive import pose_text, read_drive

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
            print(f"    maybe {pose_text(place.T_map_sensor)}, probability {place.probability:.2f}")

    # Odometry may start anywhere: only the motion between the scans is sent.
    together = client.localize(ScanSequence.along(scans, T_odom_sensor), map_id=given.map, encoding="compact")

if together.verdict is not Verdict.LOCALIZED:
    sys.exit(3)
print(f"together: localized, {pose_text(together.T_map_sensor)}, probability {together.probability:.3f}")
