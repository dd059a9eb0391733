"""Queries over a weak link: how long they take by each client and encoding, and whether one is lost.

    firstfix-lab weak_link --store DIR --map ID [--queries 100] [--json FILE] SCAN...

1 Mbit/s and 2 % loss both ways, with 200 ms there and back and with 200 ms each way. The service is a real
``firstfix serve`` at this end; each row is a process in a network namespace at the other. Needs root.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .link import Conditions, missing
from .measure import measure

RATE_BIT_S, LOSS = 1e6, 0.02
DELAYS_S = {"100 ms each way": 0.1, "200 ms each way": 0.2}


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--store", required=True, type=Path)
    parser.add_argument("--map", required=True)
    parser.add_argument(
        "--queries", type=int, default=100, help="compact ones of each client; fewer larger ones"
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument("scans", nargs="+", type=Path, metavar="SCAN")
    given = parser.parse_args(argv)
    if why := missing():
        sys.exit(f"no weak link: {why}")
    figures: dict[str, dict[str, object]] = {}
    for name, delay_s in DELAYS_S.items():
        conditions = Conditions(RATE_BIT_S, delay_s, LOSS)
        with tempfile.TemporaryDirectory() as folder:
            scans = tuple(str(path.resolve()) for path in given.scans)
            rows = measure(conditions, Path(folder), given.store.resolve(), given.map, scans, given.queries)
            figures[name] = {}
            for row, measured in rows:
                figures[name][row] = measured
                print(f"{name}, {row}: {json.dumps(measured)}", flush=True)
    if given.json is not None:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")
