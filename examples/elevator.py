"""Finds the floor and the pose of a robot when the doors of an elevator open.

    python elevator.py --url http://service:8080 SCAN                         # all maps of the service
    python elevator.py --url http://service:8080 --floors ground,first SCAN   # one of these maps
    python elevator.py --url http://service:8080 --floors first SCAN          # this map, from the elevator

Every floor has its own map. Exit codes: 0 localized, prints map and pose; 2 no such map; 3 several floors
look alike; 4 no floor fits.
"""

import argparse
import sys

from recorded_drive import pose_text

from firstfix.errors import NotFound
from firstfix_client import Client, Verdict

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--floors", default="", help="maps, separated by commas; none: all maps")
parser.add_argument("scan")
given = parser.parse_args()

with Client(given.url) as client:
    try:
        fix = client.localize(given.scan, map_id=given.floors)  # the best place in any map wins
    except NotFound as error:
        served = ", ".join(one.map_id for one in client.maps())
        print(f"{error}; the service has {served}")
        sys.exit(2)
    if fix.verdict is Verdict.LOCALIZED:
        print(f"map {fix.map_id}: {pose_text(fix.T_map_sensor)}")
        # The floor is known now. Later queries name its map and are answered faster.
        again = client.localize(given.scan, map_id=fix.map_id)
        print(f"again, on this map alone: {again.verdict.value}")
        sys.exit(0)

# Hypotheses are sorted, best first. One that is ten times less likely than the best does not count.
rivals = [place for place in fix.hypotheses if place.probability > 0.1 * fix.hypotheses[0].probability]
floors = sorted({place.map_id or given.floors for place in rivals})
if fix.verdict is Verdict.AMBIGUOUS and len(floors) > 1:
    # No scan can tell floors apart that are built alike. The elevator, a barometer or a door sign can.
    print(f"ambiguous: floors {', '.join(floors)} look alike here; ask the elevator and name the floor")
    sys.exit(3)
print(f"{fix.verdict.value}: {', '.join(reason.value for reason in fix.reasons)}")
sys.exit(3 if fix.verdict is Verdict.AMBIGUOUS else 4)
