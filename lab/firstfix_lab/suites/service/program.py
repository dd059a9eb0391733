"""Parts of the suite over a version that is there: ``firstfix-lab service_parts --help``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firstfix.scan.scan import Scan

from .queried_version import QueriedVersion
from .suite import FULL, PARTS, QUICK, measure


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab service_parts", description=__doc__)
    parser.add_argument("--version", type=Path, required=True, metavar="DIR", help="files of a version")
    parser.add_argument("--scans", type=Path, required=True, metavar="NPZ", help="(n, 3) arrays of points")
    parser.add_argument("--part", action="append", choices=PARTS, help="only this; may be repeated")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args(argv)
    scans = [Scan(points) for points in np.load(chosen.scans).values()]
    templates = len(np.load(chosen.version / "template_position_m.npy", mmap_mode="r"))
    queried = QueriedVersion(chosen.version.name, chosen.version, templates, scans)
    json.dump(measure(queried, chosen.part or PARTS, QUICK if chosen.quick else FULL), sys.stdout, indent=1)
