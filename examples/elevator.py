"""The doors of an elevator open: on which floor is the robot, and where?

    python elevator.py --url http://service:8080 SCAN                         # on any map of the service
    python elevator.py --url http://service:8080 --floors ground,first SCAN   # on one of these
    python elevator.py --url http://service:8080 --floors first SCAN          # on this one, says the elevator

Every floor is a map of its own. Ends with 0 and map and pose, with 3 if floors look alike, with 4 if none
fits, with 2 if the service has no such map.
"""

import argparse
import sys

from recorded_drive import told

from firstfix.errors import NotFound
from firstfix_client import Client, Verdict

parser = argparse.ArgumentParser()
parser.add_argument("--url", required=True)
parser.add_argument("--floors", default="", help="maps, with commas between them; none: all")
parser.add_argument("scan")
given = parser.parse_args()

with Client(given.url) as client:
    try:
        fix = client.localize(given.scan, map_id=given.floors)  # their places compete
    except NotFound as error:
        served = ", ".join(one.map_id for one in client.maps())
        print(f"{error}; the service has {served}")
        sys.exit(2)
    if fix.verdict is Verdict.LOCALIZED:
        print(f"map {fix.map_id}: {told(fix.T_map_sensor)}")
        # From here on the floor is known: later queries name it, and are answered faster.
        again = client.localize(given.scan, map_id=fix.map_id)
        print(f"again, on this map alone: {again.verdict.value}")
        sys.exit(0)

# Best first; what is a tenth as likely as the best is no rival.
rivals = [place for place in fix.hypotheses if place.probability > 0.1 * fix.hypotheses[0].probability]
floors = sorted({place.map_id or given.floors for place in rivals})
if fix.verdict is Verdict.AMBIGUOUS and len(floors) > 1:
    # Storeys built alike: no scan tells them apart. The elevator does, or a barometer, or a door's number.
    print(f"ambiguous: floors {', '.join(floors)} look alike here; ask the elevator and name the floor")
    sys.exit(3)
print(f"{fix.verdict.value}: {', '.join(reason.value for reason in fix.reasons)}")
sys.exit(3 if fix.verdict is Verdict.AMBIGUOUS else 4)
